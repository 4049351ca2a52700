// What is not axes and not frames: the header's facts, the digital lines, alarms and events.

import { byId, bytes, duration, element, mark, number, write } from "./dom.js";

/** How many events stand on the page. */
const EVENTS = 200;

/** The header. */
export function showFacts(picture) {
  const { set } = picture;
  if (!set) return;
  write(byId("name"), set.name);
  write(byId("up"), duration(set.up_s));
  write(byId("time"), `${picture.time_s.toFixed(1)} s`);
  write(byId("scale"), `× ${set.time_scale}`);
  write(byId("rate"), number(picture.commands.per_second + picture.answers.per_second));
  const lost = set.lost + picture.lost;
  write(byId("lost"), number(lost));
  mark(byId("lost"), "data-bad", lost > 0 ? "" : null);
  const restarts = set.processes.reduce((sum, { restarts: times }) => sum + times, 0);
  write(byId("restarts"), number(restarts));
  mark(byId("restarts"), "data-bad", restarts > 0 ? "" : null);
  const { state, trouble, log, bytes: length } = set.recorder;
  write(byId("recorder"), state === "recording" && trouble ? "NO LOG" : state.replaceAll("_", " "));
  mark(byId("recorder"), "data-bad", state === "recording" && !trouble ? null : "");
  mark(byId("recorder"), "title", trouble && `${trouble.reason}; nothing moves. ${trouble.advice}`);
  write(byId("log"), `${log.split("/").pop()}, ${bytes(length)}`);
  mark(byId("log"), "title", log);
}

/** The digital lines. With `order`, outputs are switches. */
export class Digital {
  constructor(order) {
    this.order = order;
    this.built = {};
  }

  show(picture, control) {
    this.#lines("outputs", picture.outputs.lines, control);
    this.#lines("inputs", picture.inputs.lines, false);
  }

  #lines(id, lines, switches) {
    const layout = JSON.stringify([switches, lines.map(({ bit, name }) => [bit, name])]);
    if (this.built[id]?.layout !== layout) {
      const made = lines.map((line) => {
        const lamp = element(switches ? "button" : "span", { class: "line", "data-line": line.name });
        lamp.append(element("i", { class: "led", "aria-hidden": "true" }), line.name.replaceAll("_", " "));
        if (switches) {
          lamp.type = "button";
          lamp.addEventListener("click", () => this.order("output", { line: line.bit, on: lamp.dataset.on !== "true" }));
        } else lamp.setAttribute("role", "img");
        return lamp;
      });
      byId(id).replaceChildren(...made.map((lamp) => element("li", {}, lamp)));
      this.built[id] = { layout, made };
    }
    lines.forEach((line, index) => {
      const lamp = this.built[id].made[index];
      mark(lamp, "data-on", line.on ?? "unknown");
      if (switches) mark(lamp, "aria-pressed", line.on ?? "mixed");
      else mark(lamp, "aria-label", `${line.name}: ${line.on === null ? "unknown" : line.on ? "on" : "off"}`);
    });
  }
}

/** Alarms and events, the newest first. */
export class Events {
  count = 0;

  clear() {
    this.count = 0;
    byId("events").replaceChildren();
    write(byId("events-count"), "");
  }

  add({ events }) {
    const list = byId("events");
    for (const event of events) {
      list.prepend(
        element(
          "li",
          { class: event.error ? "error" : "warning" },
          element("time", {}, event.time_s.toFixed(3)),
          element("b", {}, event.name),
          element("span", {}, event.message),
        ),
      );
    }
    while (list.childElementCount > EVENTS) list.lastElementChild.remove();
    this.count += events.length;
    write(byId("events-count"), number(this.count));
  }
}
