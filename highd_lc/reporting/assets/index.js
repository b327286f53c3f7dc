/* The table of all events. Only the rows in view are in the document, so that thousands scroll as smoothly as ten. */

const ROW = 34, SPARE = 12, PRINTED = 2000;

class EventTable {
  /* data: {columns: [{key, title, unit, digits, kind}], rows: [[...]], gains: {form/accounting: [...]}, ...}. */
  constructor(data, frame) {
    this.data = data;
    this.frame = frame;
    this.key = Object.fromEntries(data.columns.map((column, k) => [column.key, k]));
    this.order = { column: this.key.gain, descending: true };
    this.body = node("tbody", {});
    this.heads = data.columns.map((column, k) => this.head(column, k));
    const widths = node("colgroup", {}, ...data.columns.map((c) => node("col", { style: `width: ${c.width}rem` })));
    this.table = node("table", { "aria-rowcount": data.rows.length + 1 }, widths,
      node("thead", {}, node("tr", {}, ...this.heads)), this.body);
    frame.append(this.table);
    frame.addEventListener("scroll", () => this.draw());
    addEventListener("resize", () => this.draw());
    addEventListener("beforeprint", () => this.draw(PRINTED));
    addEventListener("afterprint", () => this.draw());
    this.choose(data.cells[0]);
  }

  head(column, k) {
    const unit = column.unit ? [" ", node("span", { class: "unit" }, `[${column.unit}]`)] : [];
    if (column.kind === "spark") return node("th", { scope: "col" }, column.title, ...unit);
    const button = node("button", { type: "button" }, column.title, ...unit);
    button.addEventListener("click", () => {
      const descending = this.order.column === k ? !this.order.descending : column.kind === "number" || column.kind === "gain";
      this.sort(k, descending);
    });
    return node("th", { scope: "col", class: column.kind === "number" || column.kind === "gain" ? "n" : null }, button);
  }

  /* Which form and accounting the columns of gain, totals and status speak of. */
  choose(cell) {
    const { status, gain, total_benchmark: totals } = this.data.values[cell];
    this.data.rows.forEach((row, k) => {
      row[this.key.status] = status[k] === null ? null : this.data.statuses[status[k]];
      row[this.key.gain] = gain[k];
      row[this.key.total_benchmark] = totals[k];
      row[this.key.total_local] = gain[k] === null ? null : totals[k] * (1 - gain[k] / 100);
    });
    const known = gain.filter((g) => g !== null).map(Math.abs).sort((a, b) => a - b);
    this.largest = known[Math.floor(0.98 * (known.length - 1))] || 1;
    this.apply();
  }

  filter(test) {
    this.test = test;
    this.apply();
  }

  sort(column, descending) {
    this.order = { column, descending };
    this.apply();
    this.frame.scrollTop = 0;
  }

  apply() {
    const { column, descending } = this.order;
    const sign = descending ? -1 : 1;
    const compare = (a, b) => {
      const [x, y] = [a[column], b[column]];
      if (x === null || y === null) return (x === null) - (y === null);
      return sign * (x < y ? -1 : x > y ? 1 : 0);
    };
    this.rows = this.data.rows.filter((row) => !this.test || this.test(row, this.key)).sort(compare);
    this.heads.forEach((head, k) => {
      if (k === column) head.setAttribute("aria-sort", descending ? "descending" : "ascending");
      else head.removeAttribute("aria-sort");
    });
    this.range = "";
    this.draw();
    if (this.onChange) this.onChange(this.rows);
  }

  draw(all) {
    const first = all ? 0 : Math.max(Math.floor(this.frame.scrollTop / ROW) - SPARE, 0);
    const count = all || Math.ceil(this.frame.clientHeight / ROW) + 2 * SPARE;
    const last = Math.min(first + count, this.rows.length);
    if (this.range === `${first}-${last}`) return;
    this.range = `${first}-${last}`;
    const gap = (rows) => node("tr", { class: "gap", "aria-hidden": "true" },
      node("td", { colspan: this.heads.length, style: `height: ${rows * ROW}px` }));
    this.body.replaceChildren(gap(first), ...this.rows.slice(first, last).map((row, k) => this.row(row, first + k)),
      gap(this.rows.length - last));
  }

  row(row, index) {
    return node("tr", { "aria-rowindex": index + 2 }, ...this.data.columns.map((column, k) => this.cell(column, row[k], row)));
  }

  cell(column, value, row) {
    if (column.kind === "event") {
      const link = node("a", { href: `events/${encodeURIComponent(value)}.html` }, value);
      return node("td", {}, row[this.key.page] === false ? value : link);
    }
    if (column.kind === "number") return node("td", { class: "n" }, fixed(value, column.digits));
    if (column.kind === "gain") return this.gain(value);
    if (column.kind === "spark") return node("td", {}, ...this.spark(value));
    return node("td", {}, value === null ? "–" : value);
  }

  gain(value) {
    if (value === null) return node("td", { class: "n none" }, "–");
    const width = Math.min(Math.abs(value) / this.largest, 1) * 40;
    return node("td", { class: "n" }, node("span", { class: `bar ${value >= 0 ? "better" : "worse"}`, style: `width: ${width.toFixed(1)}px` }),
      ` ${fixed(value, 2)}`);
  }

  spark(pair) {
    if (!pair) return [];
    const decoded = pair.map((text) => Array.from(new Int8Array(bytes(text).buffer)));
    const all = decoded.flat();
    const low = Math.min(...all), high = Math.max(Math.max(...all), low + 20);
    const svg = mark("svg", { class: "spark", viewBox: "0 0 96 26", "aria-hidden": "true" });
    decoded.forEach((values, k) => {
      const d = values.map((v, i) => `${i ? "L" : "M"}${(2 + (92 * i) / (values.length - 1)).toFixed(1)} ${(24 - (22 * (v - low)) / (high - low)).toFixed(1)}`).join("");
      svg.append(mark("path", { d, style: `stroke: var(--policy-${k ? "local_optimum" : "benchmark"})` }));
    });
    return [svg];
  }
}

const choice = (id) => document.getElementById(id).value;

function filterTest() {
  const words = choice("search").toLowerCase().split(/\s+/).filter(Boolean);
  const equal = ["recording_id", "ego_class", "direction", "status"].map((key) => [key, choice(key)]).filter(([, value]) => value);
  const limit = (id) => (choice(id) === "" ? null : Number(choice(id)));
  const [low, high] = [limit("gain_from"), limit("gain_to")];
  return (row, key) => {
    if (equal.some(([name, value]) => String(row[key[name]]) !== value)) return false;
    const gain = row[key.gain];
    if (low !== null && !(gain !== null && gain >= low)) return false;
    if (high !== null && !(gain !== null && gain <= high)) return false;
    if (!words.length) return true;
    const text = ["event_id", "recording_id", "ego_class", "direction", "status"].map((name) => row[key[name]]).join(" ").toLowerCase();
    return words.every((word) => text.includes(word));
  };
}

function startIndex() {
  const table = new EventTable(payload("data"), document.getElementById("events"));
  const count = document.getElementById("count");
  table.onChange = (rows) => { count.textContent = `${rows.length} of ${table.data.rows.length} events`; };
  for (const id of ["search", "recording_id", "ego_class", "direction", "status", "gain_from", "gain_to"]) {
    document.getElementById(id).addEventListener("input", () => table.filter(filterTest()));
  }
  document.getElementById("cell").addEventListener("change", (event) => table.choose(event.target.value));
  document.getElementById("best").addEventListener("click", () => table.sort(table.key.gain, true));
  document.getElementById("worst").addEventListener("click", () => table.sort(table.key.gain, false));
  document.getElementById("clear").addEventListener("click", () => {
    document.querySelectorAll(".filters [data-filter]").forEach((field) => { field.value = ""; });
    table.filter(null);
  });
  table.apply();
}

startIndex();
