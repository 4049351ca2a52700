// The stream of frames: what has come is kept, what the filter lets through is shown.

import { byId, element, mark, number, write } from "./dom.js";

/** How many are kept, and how many of them are shown. */
const KEPT = 2000;
const SHOWN = 300;

export class Frames {
  kept = [];
  fresh = [];
  missed = 0;
  paused = false;

  /** `onSamples` is called when samples are wanted, or not any more. */
  constructor(onSamples) {
    for (const id of ["filter-axis", "filter-text"]) byId(id).addEventListener("input", () => this.#all());
    byId("samples").addEventListener("change", onSamples);
    byId("pause").addEventListener("click", () => this.#pause());
  }

  get samples() {
    return byId("samples").checked;
  }

  /** The titles, and the axes to choose from. */
  head(picture) {
    write(byId("frames-head"), picture.frames_title);
    const chosen = byId("filter-axis").value;
    const options = picture.axes.map(({ axis, name }) => element("option", { value: axis }, `${axis} ${name}`));
    byId("filter-axis").replaceChildren(element("option", { value: "" }, "all"), ...options);
    byId("filter-axis").value = chosen;
  }

  clear() {
    [this.kept, this.missed] = [[], 0];
    this.#all();
  }

  add({ frames, missed }) {
    this.missed += missed;
    this.kept.push(...frames);
    if (this.kept.length > KEPT) this.kept.splice(0, this.kept.length - KEPT);
    this.fresh.push(...frames);
  }

  /** Writes what has come since the last time. */
  draw() {
    if (this.paused || !this.fresh.length) return;
    const lines = this.fresh.filter((frame) => this.#wanted(frame)).slice(-SHOWN);
    this.fresh = [];
    if (lines.length) this.#append(lines);
    this.#count();
  }

  #wanted(frame) {
    const axis = byId("filter-axis").value;
    const text = byId("filter-text").value.trim().toLowerCase();
    if (axis && frame.card !== Number(axis) && frame.card !== 0) return false;
    return !text || frame.text.toLowerCase().includes(text);
  }

  #append(lines) {
    const [box, list] = [byId("frames"), byId("frames-lines")];
    // Who has scrolled up to read something is not pulled away from it.
    const follows = box.scrollHeight - box.scrollTop - box.clientHeight < 30;
    list.append(...lines.map((frame) => element("span", { class: frame.lane }, frame.text)));
    while (list.childElementCount > SHOWN) list.firstElementChild.remove();
    if (follows) box.scrollTop = box.scrollHeight;
  }

  #all() {
    this.fresh = [];
    byId("frames-lines").replaceChildren();
    this.#append(this.kept.filter((frame) => this.#wanted(frame)).slice(-SHOWN));
    const box = byId("frames");
    box.scrollTop = box.scrollHeight;
    this.#count();
  }

  #pause() {
    this.paused = !this.paused;
    mark(byId("pause"), "aria-pressed", this.paused);
    write(byId("pause"), this.paused ? "Go on" : "Pause");
    if (!this.paused) this.#all();
  }

  #count() {
    const missed = this.missed ? `, ${number(this.missed)} missed` : "";
    write(byId("frames-count"), `${number(byId("frames-lines").childElementCount)} shown${missed}`);
  }
}
