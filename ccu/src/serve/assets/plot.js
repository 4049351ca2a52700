// A curve of the last seconds on a canvas. Values hold until the next one, as a card's last word does.

/** How many seconds are shown. */
export const SPAN = 20;

let colours = {};

/** Reads the colours of the style sheet again. */
export function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ["position", "speed", "grid", "muted"]) colours[name] = style.getPropertyValue(`--${name}`).trim();
}

/** The next of 1, 2, 5, 10, 20, 50, … */
function round(value) {
  const ten = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((step) => step * ten).find((step) => step >= value);
}

/** As short as a number can be. */
function short(value) {
  const size = Math.abs(value);
  const text = size >= 10_000 && size % 100 === 0 ? `${size / 1000}k` : String(size);
  return value < 0 ? `\u2212${text}` : text;
}

export class Plot {
  /** `colour` names a colour of the style sheet; `symmetric` curves have their zero in the middle. */
  constructor(canvas, colour, symmetric) {
    Object.assign(this, { canvas, colour, symmetric, times: [], values: [] });
  }

  /** One more value; null for one that is not known. */
  push(time, value) {
    this.times.push(time);
    this.values.push(value);
    const old = this.times.findIndex((time_) => time_ >= time - SPAN) - 1;
    if (old > 100) [this.times, this.values] = [this.times.slice(old), this.values.slice(old)];
  }

  /** What was before everything that was pushed. */
  precede(times, values) {
    const first = this.times[0] ?? Infinity;
    const count = times.filter((time) => time < first).length;
    this.times = times.slice(0, count).concat(this.times);
    this.values = values.slice(0, count).concat(this.values);
  }

  clear() {
    [this.times, this.values] = [[], []];
  }

  /** Draws the curve up to `now`. */
  draw(now) {
    const { canvas, times, values } = this;
    const ratio = devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width) return;
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const [low, high] = this.#range(now);
    const margin = 3;
    const x = (time) => width - ((now - time) / SPAN) * width;
    const y = (value) => height - margin - ((value - low) / (high - low)) * (height - 2 * margin);
    pen.lineWidth = 1;
    pen.strokeStyle = colours.grid;
    pen.beginPath();
    for (let second = 5; second < SPAN; second += 5) {
      const at = Math.round(x(now - second)) + 0.5;
      pen.moveTo(at, 0);
      pen.lineTo(at, height);
    }
    if (this.symmetric) {
      const zero = Math.round(y(0)) + 0.5;
      pen.moveTo(0, zero);
      pen.lineTo(width, zero);
    }
    pen.stroke();
    pen.strokeStyle = colours[this.colour];
    pen.lineWidth = 1.5;
    pen.lineJoin = "round";
    pen.beginPath();
    let last = null;
    for (let index = 0; index < times.length; index += 1) {
      const value = values[index];
      if (value === null) {
        last = null;
        continue;
      }
      // A point in each sample: what moves is sampled often enough that straight lines tell the truth.
      if (last === null) pen.moveTo(x(times[index]), y(value));
      else pen.lineTo(x(times[index]), y(value));
      last = value;
    }
    if (last !== null) pen.lineTo(x(now), y(last));
    pen.stroke();
    pen.fillStyle = colours.muted;
    pen.font = "10px system-ui, sans-serif";
    pen.textBaseline = "top";
    pen.fillText(short(high), 3, 1);
    pen.textBaseline = "bottom";
    pen.fillText(short(low), 3, height - 1);
  }

  /** The lowest and the highest value of the paper: round ones around what there is to show. */
  #range(now) {
    const shown = this.values.filter((value, index) => value !== null && this.times[index] >= now - SPAN - 1);
    if (this.symmetric) {
      const most = round(Math.max(1000, ...shown.map(Math.abs)));
      return [-most, most];
    }
    if (!shown.length) return [0, 100];
    const [least, most] = [Math.min(...shown), Math.max(...shown)];
    const step = round(Math.max(100, (most - least) / 2));
    const low = Math.floor(least / step) * step;
    const high = Math.ceil(most / step) * step;
    return low === high ? [low - step, high + step] : [low, high];
  }
}
