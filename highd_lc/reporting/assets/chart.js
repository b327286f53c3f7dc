/* Line charts over time with a cursor, drawn as SVG. A series is {name, colour, dash, width, x, y, label, hidden}. Where
   one is hidden, names in the legend show and hide the lines. */

/* A drawing takes the whole width: on a small screen it gets fewer units, so that its letters stay legible. */
const SMALL = matchMedia("(max-width: 40rem)").matches;
const CHART = { width: SMALL ? 380 : 560, height: 216, left: 54, right: 34, top: 16, bottom: 38 };

function niceTicks(low, high, count) {
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw * 0.999);
  const ticks = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) ticks.push(k * step);
  return { step, ticks, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

function range(series, pick, least) {
  let low = Infinity, high = -Infinity;
  for (const s of series) {
    for (const value of pick(s)) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (!(low <= high)) return [0, 1];
  const pad = Math.max((least - (high - low)) / 2, 0.04 * (high - low));
  return [low - pad, high + pad];
}

function valueAt(series, x) {
  const { x: xs, y: ys } = series;
  if (!xs.length || x < xs[0] - 1e-6 || x > xs[xs.length - 1] + 1e-6) return NaN;
  const at = Math.min(Math.max((x - xs[0]) / (xs[1] - xs[0] || 1), 0), xs.length - 1);
  const k = Math.min(Math.floor(at + 1e-9), xs.length - 1);
  const next = Math.min(k + 1, xs.length - 1);
  return ys[k] + (at - k) * (ys[next] - ys[k]);
}

class Chart {
  /* figure: its element; options: {title, unit, least (smallest y range), onScrub(x)}. */
  constructor(figure, options) {
    this.figure = figure;
    this.options = { xLabel: "time since start [s]", digits: 2, least: 0, ...options };
    this.svg = mark("svg", { viewBox: `0 0 ${CHART.width} ${CHART.height}`, role: "img" });
    this.legend = node("p", { class: "legend" });
    this.shown = null;
    this.at = NaN;
    figure.classList.add("chart");
    const heading = node("h3", {}, options.title + " ", node("span", { class: "unit" }, `[${options.unit}]`));
    figure.append(node("div", { class: "head" }, heading, this.tools()), this.svg, this.legend);
    if (options.onScrub) this.listen();
  }

  tools() {
    const button = (text, label, act) => {
      const element = node("button", { type: "button", title: label, "aria-label": `${label}: ${this.options.title}` }, text);
      element.addEventListener("click", act);
      return element;
    };
    return node("span", { class: "tools screen" },
      button("+", "Zoom in", () => this.zoom(2)), button("−", "Zoom out", () => this.zoom(0.5)),
      button("CSV", "Data of this chart as CSV", () => this.save()));
  }

  /* Show a part of the time about the cursor, or all of it again. */
  zoom(factor) {
    const [low, high] = this.xRange, [first, last] = this.whole;
    const middle = Number.isFinite(this.at) ? Math.min(Math.max(this.at, low), high) : (low + high) / 2;
    const width = Math.max((high - low) / factor, 0.5);
    const start = Math.min(Math.max(middle - width / 2, first), last - width);
    this.shown = width >= last - first ? null : [start, start + width];
    this.redraw();
  }

  /* One row a sample of a line, as drawn. */
  csv() {
    const quoted = (text) => `"${text.replace(/"/g, '""')}"`;
    const name = (s) => [s.name, s.label].filter(Boolean).join(", ");
    const rows = this.series.flatMap((s) => [...s.x].map((x, k) => `${quoted(name(s))},${+x.toFixed(3)},${+s.y[k].toFixed(4)}`));
    return [["series", this.options.xLabel, `${this.options.title} [${this.options.unit}]`].map(quoted).join(","), ...rows, ""].join("\n");
  }

  save() {
    const file = `${document.title} ${this.options.title}.csv`.replace(/[^\w.-]+/g, "_");
    node("a", { href: `data:text/csv;charset=utf-8,${encodeURIComponent(this.csv())}`, download: file }).click();
  }

  listen() {
    const scrub = (event) => {
      const box = this.svg.getBoundingClientRect();
      this.options.onScrub(this.invert(((event.clientX - box.left) / box.width) * CHART.width));
    };
    this.svg.addEventListener("pointerdown", (event) => {
      this.svg.setPointerCapture(event.pointerId);
      scrub(event);
    });
    this.svg.addEventListener("pointermove", (event) => { if (event.buttons) scrub(event); });
  }

  draw(series, xRange, marks = []) {
    this.all = series.filter((s) => s.x.length > 0);
    this.chosen = this.all.some((s) => s.hidden);
    this.marks = marks;
    this.whole = xRange;
    this.redraw();
  }

  redraw() {
    const [first, last] = this.whole;
    this.series = this.all.filter((s) => !s.hidden);
    this.xRange = this.shown && this.shown[0] >= first && this.shown[1] <= last ? this.shown : this.whole;
    this.yRange = range(this.series, (s) => this.visible(s).map((k) => s.y[k]), this.options.least);
    const line = (s) => mark("path", {
      class: "line", d: this.path(s), "stroke-width": s.width, "stroke-dasharray": s.dash,
      style: `stroke: ${s.colour}; stroke-opacity: ${s.opacity || 1}`,
    });
    this.cursorLine = mark("line", { class: "cursor", y1: CHART.top, y2: CHART.height - CHART.bottom });
    this.svg.replaceChildren(...this.axes(), ...this.marks.map((m) => this.verticalMark(m)),
      ...this.series.map(line), ...this.endLabels(), ...(this.options.onScrub ? [this.cursorLine] : []));
    this.svg.setAttribute("aria-label", this.alternative());
    this.drawLegend();
    if (this.options.onScrub && Number.isFinite(this.at)) this.cursor(this.at);
  }

  /* Samples of a line in the part of the time that is shown. */
  visible(s) {
    const [low, high] = this.xRange;
    return [...s.x.keys()].filter((k) => s.x[k] >= low - 1e-9 && s.x[k] <= high + 1e-9);
  }

  x(value) {
    const [low, high] = this.xRange;
    return CHART.left + ((value - low) / (high - low)) * (CHART.width - CHART.left - CHART.right);
  }

  invert(pixel) {
    const [low, high] = this.xRange;
    const share = (pixel - CHART.left) / (CHART.width - CHART.left - CHART.right);
    return Math.min(Math.max(low + share * (high - low), low), high);
  }

  y(value) {
    const [low, high] = this.yRange;
    return CHART.height - CHART.bottom - ((value - low) / (high - low)) * (CHART.height - CHART.top - CHART.bottom);
  }

  path(s) {
    return this.visible(s).map((k, n) => `${n ? "L" : "M"}${this.x(s.x[k]).toFixed(1)} ${this.y(s.y[k]).toFixed(1)}`).join("");
  }

  axes() {
    const parts = [];
    const base = CHART.height - CHART.bottom;
    const yTicks = niceTicks(...this.yRange, 4);
    for (const value of yTicks.ticks) {
      const y = this.y(value).toFixed(1);
      parts.push(mark("line", { class: "grid", x1: CHART.left, x2: CHART.width - CHART.right, y1: y, y2: y }),
        mark("text", { class: "tick", x: CHART.left - 6, y: +y + 4, "text-anchor": "end" }, fixed(value, yTicks.digits)));
    }
    const xTicks = niceTicks(...this.xRange, SMALL ? 5 : 7);
    for (const value of xTicks.ticks) {
      const x = this.x(value).toFixed(1);
      parts.push(mark("line", { class: "axis", x1: x, x2: x, y1: base, y2: base + 4 }),
        mark("text", { class: "tick", x, y: base + 16, "text-anchor": "middle" }, fixed(value, xTicks.digits)));
    }
    parts.push(mark("line", { class: "axis", x1: CHART.left, x2: CHART.width - CHART.right, y1: base, y2: base }),
      mark("text", { class: "tick", x: CHART.width - CHART.right, y: CHART.height - 2, "text-anchor": "end" }, this.options.xLabel));
    return parts;
  }

  verticalMark({ x, label }) {
    if (!Number.isFinite(x) || x < this.xRange[0] || x > this.xRange[1]) return mark("g");
    const at = this.x(x).toFixed(1);
    return mark("g", {},
      mark("line", { class: "mark", x1: at, x2: at, y1: CHART.top, y2: CHART.height - CHART.bottom }),
      mark("text", { class: "tick", x: at, y: CHART.top - 4, "text-anchor": "middle" }, label));
  }

  endLabels() {
    const end = (s) => this.y(s.y[this.visible(s).pop()]) + 4;
    let last = -Infinity;
    return this.series.filter((s) => s.label && this.visible(s).length).sort((a, b) => end(a) - end(b)).map((s) => {
      last = Math.max(end(s), last + 11);
      return mark("text", { class: "tick", x: CHART.width - CHART.right + 4, y: last.toFixed(1) }, s.label);
    });
  }

  drawLegend() {
    const seen = new Map();
    for (const s of this.all) if (s.name && !seen.has(s.name)) seen.set(s.name, s);
    this.values = [];
    this.legend.replaceChildren(...[...seen.values()].map((s) => {
      const value = node("span", {});
      this.values.push([s, value]);
      const key = mark("svg", { viewBox: "0 0 26 8", "aria-hidden": "true" },
        mark("line", { x1: 0, x2: 26, y1: 4, y2: 4, "stroke-width": s.width, "stroke-dasharray": s.dash, style: `stroke: ${s.colour}` }));
      return this.chosen ? this.choice(s, key) : node("span", {}, key, s.name + " ", value);
    }));
  }

  /* A name in the legend that shows or hides its line. */
  choice(s, key) {
    const button = node("button", { type: "button", "aria-pressed": `${!s.hidden}`, title: s.hidden ? "Show" : "Hide" }, key, s.name);
    button.addEventListener("click", () => {
      const place = [...this.legend.children].indexOf(button);
      s.hidden = !s.hidden;
      this.redraw();
      this.legend.children[place].focus();
    });
    return button;
  }

  cursor(x) {
    this.at = x;
    const at = this.x(Math.min(Math.max(x, this.xRange[0]), this.xRange[1])).toFixed(1);
    this.cursorLine.setAttribute("x1", at);
    this.cursorLine.setAttribute("x2", at);
    for (const [s, element] of this.values) element.textContent = fixed(valueAt(s, x), this.options.digits);
  }

  alternative() {
    const sentence = (s) => {
      const low = Math.min(...s.y), high = Math.max(...s.y);
      return `${s.name || ""} ${s.label || ""} from ${fixed(s.y[0], 2)} to ${fixed(s.y[s.y.length - 1], 2)}, `
        + `lowest ${fixed(low, 2)}, highest ${fixed(high, 2)}`;
    };
    return `${this.options.title} in ${this.options.unit} over ${this.options.xLabel}. ${this.series.map(sentence).join("; ")}.`;
  }
}
