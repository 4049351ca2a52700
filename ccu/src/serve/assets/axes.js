// The axes: one row each, built once and then only changed where something has changed.

import { byId, element, mark, number, write } from "./dom.js";
import { Plot, SPAN } from "./plot.js";

const POINTS = [
  ["X1", "lower limit zone"],
  ["X2", "upper limit zone"],
  ["X3", "reference step"],
  ["X4", "motion complete"],
  ["X5", "slower than S1"],
];

class Row {
  constructor(axis) {
    const { rail, name } = axis;
    this.rail = rail;
    const from = rail.lower_stop;
    const length = rail.upper_stop - from;
    this.percent = (position) => `${(Math.min(Math.max((position - from) / length, 0), 1) * 100).toFixed(3)}%`;

    this.activity = element("span", { class: "activity" });
    this.carriage = element("i", { class: "carriage", hidden: "" });
    const part = (kind, start, end) => {
      const made = element("i", { class: kind });
      made.style.left = this.percent(start);
      if (end !== undefined) made.style.width = `calc(${this.percent(end)} - ${this.percent(start)})`;
      return made;
    };
    this.bar = element(
      "div",
      { class: "bar", role: "meter", "aria-label": `Position of ${name}`, "aria-valuemin": from, "aria-valuemax": rail.upper_stop },
      part("travel", rail.travel_min, rail.travel_max),
      part("zone lower", from, rail.lower_zone),
      part("zone upper", rail.upper_zone, rail.upper_stop),
      part("reference", rail.reference),
      this.carriage,
    );
    this.alarm = element("span", { class: "alarm", role: "alert" });
    this.position = element("span", { class: "position number" });
    this.speed = element("span", { class: "speed number" });
    this.lamps = POINTS.map(([point, meaning]) =>
      element("span", { class: "lamp", role: "img", title: `${point}: ${meaning}` }, point),
    );
    const canvas = (what) => element("canvas", { role: "img", "aria-label": `${what} of ${name}, last ${SPAN} seconds` });
    const canvases = [canvas("Position"), canvas("Speed")];
    this.plots = [new Plot(canvases[0], "position", false), new Plot(canvases[1], "speed", true)];
    this.root = element(
      "article",
      { class: "axis", "aria-label": `Axis ${axis.axis}, ${name}`, "data-axis": axis.axis },
      element("div", { class: "who" }, element("h3", {}, element("b", {}, String(axis.axis)), ` ${name}`), this.activity),
      element(
        "div",
        { class: "rail" },
        this.bar,
        element("div", { class: "ends" }, element("span", {}, number(rail.travel_min)), this.alarm, element("span", {}, number(rail.travel_max))),
      ),
      element("div", { class: "numbers" }, this.position, this.speed),
      element("div", { class: "lamps" }, ...this.lamps),
      ...canvases,
    );
  }

  show(axis, at) {
    const { root } = this;
    mark(root, "data-alive", axis.alive);
    mark(root, "data-position", axis.position ?? "unknown");
    mark(root, "data-activity", axis.activity ?? "unknown");
    mark(root, "data-alarm", axis.alarm?.cause ?? null);
    write(this.activity, axis.alive ? (axis.activity ?? "not heard yet").replaceAll("_", " ") : "nobody plays its card");
    write(this.alarm, axis.alarm ? `locked: ${axis.alarm.message}` : "");
    write(this.position, number(axis.position));
    write(this.speed, number(axis.speed));
    this.carriage.hidden = axis.position === null;
    if (axis.position !== null) this.carriage.style.left = this.percent(axis.position);
    mark(this.bar, "aria-valuenow", axis.position ?? this.rail.lower_stop);
    mark(this.bar, "aria-valuetext", axis.position === null ? "unknown" : `${axis.position} steps`);
    this.lamps.forEach((lamp, index) => {
      const on = axis.sense?.[index] === "1";
      const [point, meaning] = POINTS[index];
      mark(lamp, "data-on", on);
      mark(lamp, "aria-label", `${point}, ${meaning}: ${axis.sense ? (on ? "on" : "off") : "unknown"}`);
    });
    this.plots[0].push(at, axis.position);
    this.plots[1].push(at, axis.speed);
  }
}

export class Axes {
  rows = new Map();

  /** Shows a picture. Rows are built anew only if the set has become another. */
  show(picture) {
    const layout = JSON.stringify(picture.axes.map(({ axis, name, rail }) => [axis, name, rail]));
    const built = layout !== this.layout;
    if (built) {
      this.layout = layout;
      this.rows = new Map(picture.axes.map((axis) => [axis.axis, new Row(axis)]));
      byId("rows").replaceChildren(...[...this.rows.values()].map((row) => row.root));
    }
    for (const axis of picture.axes) this.rows.get(axis.axis).show(axis, picture.at_s);
    return built;
  }

  /** Puts what was before into the curves: slots of 100 ms, the newest last. */
  precede(picture) {
    for (const axis of picture.axes) {
      const histories = [axis.position_history, axis.speed_history];
      this.rows.get(axis.axis)?.plots.forEach((plot, index) => {
        const values = histories[index];
        plot.precede(values.map((_, slot) => picture.at_s - (values.length - slot) * 0.1), values);
      });
    }
  }

  draw(now) {
    for (const row of this.rows.values()) row.plots.forEach((plot) => plot.draw(now));
  }

  forgetCurves() {
    for (const row of this.rows.values()) row.plots.forEach((plot) => plot.clear());
  }
}
