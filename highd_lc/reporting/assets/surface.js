/* The loss surface over (T, x_final), with the region that the constraints leave and the policies' points. */

const CIVIDIS = [[0, 34, 78], [18, 53, 112], [59, 73, 108], [87, 93, 109], [112, 113, 115], [138, 134, 120],
  [165, 156, 116], [195, 179, 105], [225, 204, 85], [254, 232, 56]];

function cividis(share) {
  const at = Math.min(Math.max(share, 0), 1) * (CIVIDIS.length - 1);
  const k = Math.min(Math.floor(at), CIVIDIS.length - 2);
  return CIVIDIS[k].map((low, c) => Math.round(low + (at - k) * (CIVIDIS[k + 1][c] - low)));
}

/* Limits of motion, contact, then the constraints of the safety profile, in the order of the payload. */
const BLOCKED = [null, [150, 150, 150], [90, 90, 90], [176, 88, 141], [0, 114, 178], [86, 180, 233], [170, 120, 60],
  [213, 94, 0], [230, 159, 0], [190, 20, 60]];

function levels(packed) {
  const whole = new Uint16Array(bytes(packed.data).buffer);
  return Float64Array.from(whole, (level) => (level === 65535 ? NaN : packed.low + level * packed.scale));
}

class SurfaceView {
  constructor(figure, surface) {
    this.surface = surface;
    this.svg = mark("svg", { viewBox: "0 0 560 360", role: "img" });
    this.note = node("p", { class: "legend" });
    figure.classList.add("chart");
    figure.append(this.svg, this.note);
  }

  draw(accounting, quantity, looks) {
    const packed = this.surface.losses[accounting];
    const [av, hv] = [packed.av, packed.hv].map((k) => levels(this.surface.arrays[k]));
    const values = av.map((loss, k) => ({ av: loss, hv: hv[k], joint: 0.5 * (loss + hv[k]) })[quantity]);
    const mask = bytes(packed.feasible);
    const feasible = (k) => Boolean((mask[k >> 3] >> (k & 7)) & 1);
    const inside = [...values].filter((value, k) => feasible(k) && Number.isFinite(value)).sort((a, b) => a - b);
    const [low, high] = inside.length ? [inside[0], inside[Math.floor(0.9 * (inside.length - 1))]] : [0, 1];
    const blocked = packed.blocked ? bytes(packed.blocked) : null;
    this.svg.replaceChildren(this.image(values, feasible, low, high, blocked), ...this.axes(), ...this.points(accounting, looks));
    const name = { joint: "Joint objective, equal weights", av: "Loss of the AV", hv: "Loss of the followers" }[quantity];
    const text = inside.length
      ? `${name}: from ${fixed(low, 2)} (dark) to ${fixed(high, 2)} and above (bright) where all constraints hold. ${blocked ? "Elsewhere the colour says which constraint is violated first." : "Grey: some constraint is violated."}`
      : "No candidate of this grid meets all constraints.";
    this.note.replaceChildren(node("span", {}, text), ...this.legend(blocked));
    this.svg.setAttribute("aria-label", `${text} Points: ${this.spoken(accounting, looks)}.`);
  }

  legend(blocked) {
    const present = [...new Set(blocked || [])].filter((code) => code > 0).sort((a, b) => a - b);
    return present.map((code) => {
      const box = mark("rect", { width: 26, height: 8, fill: `rgb(${BLOCKED[code]})`, "fill-opacity": 0.55 });
      const swatch = mark("svg", { viewBox: "0 0 26 8", "aria-hidden": "true" }, box);
      return node("span", {}, swatch, this.surface.blockers[code]);
    });
  }

  image(values, feasible, low, high, blocked) {
    const [rows, columns] = [this.surface.T.length, this.surface.x.length];
    const canvas = node("canvas", { width: rows, height: columns });
    const context = canvas.getContext("2d");
    const pixels = context.createImageData(rows, columns);
    for (let i = 0; i < rows; i++) {
      for (let j = 0; j < columns; j++) {
        const k = i * columns + j;
        const p = 4 * ((columns - 1 - j) * rows + i);
        const known = Number.isFinite(values[k]);
        const colour = known ? cividis((values[k] - low) / (high - low || 1)) : [128, 128, 128];
        const grey = Array(3).fill(Math.round(colour[0] * 0.3 + colour[1] * 0.59 + colour[2] * 0.11));
        pixels.data.set(feasible(k) ? colour : (blocked && BLOCKED[blocked[k]]) || grey, p);
        pixels.data[p + 3] = feasible(k) ? 255 : blocked ? 140 : known ? 60 : 25;
      }
    }
    context.putImageData(pixels, 0, 0);
    return mark("image", {
      href: canvas.toDataURL(), x: 56, y: 12, width: 484, height: 300, preserveAspectRatio: "none",
      style: "image-rendering: pixelated",
    });
  }

  /* Cells are centred on their nodes, so the picture reaches half a cell beyond the outer nodes. */
  place(values, value) {
    const step = values[1] - values[0];
    return (value - values[0] + step / 2) / (values[values.length - 1] - values[0] + step);
  }

  x(T) { return 56 + 484 * this.place(this.surface.T, T); }

  y(offset) { return 312 - 300 * this.place(this.surface.x, offset); }

  axes() {
    const parts = [mark("rect", { class: "axis", x: 56, y: 12, width: 484, height: 300, fill: "none" })];
    const { T, x } = this.surface;
    for (const value of niceTicks(T[0], T[T.length - 1], 8).ticks) {
      parts.push(mark("text", { class: "tick", x: this.x(value).toFixed(1), y: 328, "text-anchor": "middle" }, fixed(value, 0)));
    }
    const ticks = niceTicks(x[0], x[x.length - 1], 6);
    for (const value of ticks.ticks) {
      parts.push(mark("text", { class: "tick", x: 50, y: (this.y(value) + 4).toFixed(1), "text-anchor": "end" }, fixed(value, ticks.digits)));
    }
    parts.push(mark("text", { class: "tick", x: 540, y: 346, "text-anchor": "end" }, "duration T [s]"),
      mark("text", { class: "tick", x: 14, y: 162, transform: "rotate(-90 14 162)", "text-anchor": "middle" }, "farther than at constant speed [m]"));
    return parts;
  }

  shown(accounting) {
    const { T, x, points } = this.surface;
    return points.filter(([policy, of, duration, offset]) => of === accounting
      && duration >= T[0] - 1e-9 && duration <= T[T.length - 1] + 1e-9 && offset >= x[0] && offset <= x[x.length - 1]);
  }

  points(accounting, looks) {
    const shown = this.shown(accounting).map(([policy, , T, offset]) => ({ policy, x: this.x(T), y: this.y(offset) }));
    const taken = shown.map(({ x, y }) => [x - 7, y - 7, x + 7, y + 7]);
    const circles = shown.map(({ policy, x, y }) =>
      mark("circle", { class: "point", cx: x.toFixed(1), cy: y.toFixed(1), r: 6, style: `fill: var(--policy-${policy})` }));
    return [...circles, ...shown.flatMap(({ policy, x, y }) => this.label(looks[policy].label, x, y, taken))];
  }

  widthOf(text) {
    this.measure = this.measure || node("canvas", {}).getContext("2d");
    this.measure.font = `${SMALL ? 14 : 12}px ${getComputedStyle(document.body).fontFamily}`;
    return this.measure.measureText(text).width;
  }

  /* A label where it covers no point and no other label, as near to its point as that allows, with a line to it. */
  label(text, x, y, taken) {
    const [width, height] = [this.widthOf(text), SMALL ? 17 : 15];
    const clear = ([x0, y0, x1, y1]) => x0 > 58 && x1 < 538 && y0 > 14 && y1 < 310
      && !taken.some(([u0, v0, u1, v1]) => x0 < u1 && u0 < x1 && y0 < v1 && v0 < y1);
    const box = ([left, up]) => [x + left, y + up - height / 2, x + left + width, y + up + height / 2];
    const places = [0, 1, 2, 3, 4, 5, 6, 7].flatMap((ring) => [-1, 1].flatMap((side) => {
      const up = side * ring * height;
      return [[10, up], [-10 - width, up], [-width / 2, up + side * (height / 2 + 4)]];
    }));
    const place = places.find((one) => clear(box(one))) || [10, 0];
    const [x0, y0, x1, y1] = box(place);
    taken.push([x0, y0, x1, y1]);
    const [ex, ey] = [Math.min(Math.max(x, x0), x1), Math.min(Math.max(y, y0), y1)];
    const far = Math.hypot(ex - x, ey - y) > 16;
    const line = far ? [mark("line", { class: "lead", x1: x.toFixed(1), y1: y.toFixed(1), x2: ex.toFixed(1), y2: ey.toFixed(1) })] : [];
    return [...line, mark("text", { class: "halo", x: x0.toFixed(1), y: (y1 - 3).toFixed(1) }, text)];
  }

  spoken(accounting, looks) {
    const one = ([policy, , T, offset]) => `${looks[policy].label} at T ${fixed(T, 1)} s, ${fixed(offset, 1)} m`;
    return this.shown(accounting).map(one).join("; ") || "none";
  }
}
