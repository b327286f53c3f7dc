/* The page of one event: unpack the data, then keep plan view, charts and tables on one moment and one choice. */

/* Levels to values: through the middle of every stair of one step, so that rounding does not show; jumps stay. */
function unround(levels, step) {
  const nodes = [];
  for (let start = 0, end; start < levels.length; start = end + 1) {
    end = start;
    while (end + 1 < levels.length && levels[end + 1] === levels[start]) end++;
    const stairBefore = start > 0 && Math.abs(levels[start] - levels[start - 1]) === 1;
    const stairAfter = end + 1 < levels.length && Math.abs(levels[end + 1] - levels[end]) === 1;
    if (!stairBefore) nodes.push([start, levels[start]]);
    if ((stairBefore || stairAfter) && end > start) nodes.push([(start + end) / 2, levels[start]]);
    if (!stairAfter || end === start) nodes.push([end, levels[end]]);
  }
  const values = new Float64Array(levels.length);
  for (let k = 0, n = 0; k < levels.length; k++) {
    while (n + 1 < nodes.length && nodes[n + 1][0] <= k) n++;
    const [[x0, y0], [x1, y1]] = [nodes[n], nodes[Math.min(n + 1, nodes.length - 1)]];
    values[k] = step * (x1 > x0 ? y0 + ((k - x0) * (y1 - y0)) / (x1 - x0) : y0);
  }
  return values;
}

function unpack(packed) {
  const data = new Int8Array(bytes(packed.data).buffer);
  let offset = 0;
  return packed.channels.map(([step, base, first, count]) => {
    let level = base;
    const levels = Array.from(data.subarray(offset, offset + count), (delta) => (level += delta));
    offset += count;
    return { first, values: unround(levels, step) };
  });
}

function spread({ first, values }, length, add) {
  const channel = new Float64Array(length).fill(NaN);
  values.forEach((value, k) => { channel[first + k] = value + (add ? add(first + k) : 0); });
  return channel;
}

/* Channels of a page: x comes relative to a point that drives at v0. */
function decode(data) {
  const packed = [...data.plays, ...data.others];
  const length = Math.max(...packed.map((p) => Math.max(...p.channels.map(([, , first, count]) => first + count))));
  const moving = (k) => data.v0 * data.dt * k;
  const path = (channels) => {
    const [x, y, v, a] = channels;
    return { x: spread(x, length, moving), y: spread(y, length), v: spread(v, length), a: spread(a, length) };
  };
  for (const play of data.plays) {
    const channels = unpack(play);
    play.ego = path(channels);
    play.colour = data.looks[play.policy].colour;
    play.jerk = spread(channels[4], length);
    play.followers = [];
    for (let k = 5; k < channels.length; k += 4) play.followers.push(path(channels.slice(k, k + 4)));
  }
  for (const other of data.others) Object.assign(other, path(unpack(other)));
  for (const track of data.tracks) track.ego = path(unpack(track.path));
  data.last = (length - 1) * data.dt;
  data.times = Float64Array.from({ length }, (_, k) => k * data.dt);
  return data;
}

const choose = (id) => document.getElementById(id);

class EventPage {
  constructor(data) {
    this.data = data;
    this.t = 0;
    this.playing = false;
    this.accounting = choose("accounting").value;
    this.road = new RoadView(choose("road"), data);
    this.buildCharts();
    if (data.surface) this.surface = new SurfaceView(choose("surface"), data.surface);
    this.fillPolicies();
    this.listen();
    this.drawFits();
    this.drawPrediction();
    this.drawTracks();
    this.choice();
  }

  find(policy) {
    return this.data.plays.find((p) => p.policy === policy && p.accountings.includes(this.accounting));
  }

  fillPolicies() {
    const available = Object.keys(this.data.looks).filter((policy) => this.find(policy));
    for (const [id, wanted] of [["policy", "local_optimum"], ["compare", "benchmark"]]) {
      const select = choose(id);
      const chosen = select.value || wanted;
      const options = available.map((policy) => node("option", { value: policy }, this.data.looks[policy].label));
      if (id === "compare") options.unshift(node("option", { value: "none" }, "nothing"));
      select.replaceChildren(...options);
      const fallback = id === "compare" ? "none" : available.includes("human") ? "human" : available[0];
      select.value = available.includes(chosen) || (chosen === "none" && id === "compare") ? chosen : fallback;
    }
  }

  listen() {
    for (const id of ["policy", "compare"]) choose(id).addEventListener("change", () => this.choice());
    choose("accounting").addEventListener("change", (event) => {
      this.accounting = event.target.value;
      this.fillPolicies();
      this.choice();
    });
    choose("play").addEventListener("click", () => this.toggle());
    const slider = choose("time");
    slider.max = this.data.last.toFixed(2);
    slider.step = this.data.dt;
    slider.addEventListener("input", () => { this.pause(); this.move(Number(slider.value)); });
    document.addEventListener("keydown", (event) => this.key(event));
    const quantity = choose("quantity");
    if (quantity) quantity.addEventListener("change", () => this.drawSurface());
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || /^(SELECT|TEXTAREA)$/.test(event.target.tagName)) return;
    if (event.key === " " && /^(BUTTON|SUMMARY|A)$/.test(event.target.tagName)) return;
    const step = event.shiftKey ? 1 : this.data.dt;
    const policies = [...choose("policy").options];
    const actions = {
      " ": () => this.toggle(),
      ArrowLeft: () => { this.pause(); this.move(this.t - step); },
      ArrowRight: () => { this.pause(); this.move(this.t + step); },
      Home: () => this.move(0),
      End: () => this.move(this.data.last),
    };
    const number = Number(event.key);
    if (actions[event.key]) actions[event.key]();
    else if (number >= 1 && number <= policies.length) { choose("policy").value = policies[number - 1].value; this.choice(); }
    else return;
    event.preventDefault();
  }

  toggle() {
    if (this.playing) { this.pause(); return; }
    if (this.t >= this.data.last - 1e-6) this.t = 0;
    this.playing = true;
    choose("play").textContent = "Pause";
    let before = performance.now();
    const tick = (now) => {
      if (!this.playing) return;
      this.move(this.t + ((now - before) / 1000) * Number(choose("rate").value));
      before = now;
      if (this.t >= this.data.last - 1e-6) this.pause(); else requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  pause() {
    this.playing = false;
    choose("play").textContent = "Play";
  }

  /* Another policy, comparison or accounting was chosen. */
  choice() {
    this.main = this.find(choose("policy").value);
    this.compared = this.find(choose("compare").value);
    if (this.compared === this.main) this.compared = undefined;
    for (const element of document.querySelectorAll("[data-accounting]")) {
      element.hidden = element.dataset.accounting !== this.accounting;
    }
    this.road.frame(this.compared ? [this.main, this.compared] : [this.main]);
    this.drawCharts();
    this.drawSurface();
    this.move(this.t);
  }

  move(t) {
    this.t = Math.min(Math.max(t, 0), this.data.last);
    const slider = choose("time");
    slider.value = this.t;
    slider.setAttribute("aria-valuetext", `${fixed(this.t, 1)} seconds`);
    choose("clock").textContent = `${fixed(this.t, 1)} s`;
    this.road.draw(this.t, this.main, this.compared);
    for (const { chart } of this.charts) chart.cursor(this.t);
  }

  buildCharts() {
    const of = (channel) => (play) => [{ values: channel(play), label: "" }];
    const each = (channel) => (play) => play.followers.map((f, k) => ({ values: channel(f), label: `${k + 1}` }));
    const { leads } = this.data;
    const leader = (k) => leads.filter(([since]) => since <= k).pop()[1];
    const behindLeader = (p) => p.ego.x.map((x, k) => {
      const ahead = this.data.others.find((other) => other.role === leader(k));
      return ahead ? ahead.x[k] - x - (boxes[ahead.role][0] + boxes.ego[0]) / 2 : NaN;
    });
    const gap = (ahead, behind, boxes) => ahead.x.map((x, k) => x - behind.x[k] - (boxes[0][0] + boxes[1][0]) / 2);
    const { boxes } = this.data;
    const specifications = [
      ["Lateral position of the AV", "m", 1, of((p) => p.ego.y)],
      ["Speed of the AV", "m/s", 2, of((p) => p.ego.v)],
      ["Acceleration of the AV", "m/s²", 1, of((p) => p.ego.a)],
      ["Jerk charged to the AV, |jx| + |jy|", "m/s³", 1, of((p) => p.jerk)],
    ];
    if (this.data.plays.some((p) => p.followers.length)) {
      specifications.push(["Speed of the followers", "m/s", 2, each((f) => f.v)],
        ["Acceleration of the followers", "m/s²", 1, each((f) => f.a)],
        ["Gap between AV and HV 1", "m", 5, of((p) => gap(p.ego, p.followers[0], [boxes.ego, boxes.target_follower_1]))]);
    }
    if (leads.length) specifications.push(["Gap between AV and the leader of the target lane", "m", 5, of(behindLeader)]);
    this.charts = specifications.map(([title, unit, least, channels]) => {
      const several = title.endsWith("followers");
      const figure = node("figure", {});
      choose("charts").append(figure);
      const onScrub = (t) => { this.pause(); this.move(t); };
      const ofEgo = /^(Lateral position|Speed|Acceleration) of the AV$/.test(title);
      return { chart: new Chart(figure, { title, unit, least, onScrub }), channels, several, ofEgo };
    });
  }

  /* The plays drawn in every chart: the comparison below, the chosen one on top, the human for reference. */
  drawn() {
    const human = this.find("human");
    const plays = [[this.compared, 1.5], [this.main, 2.5]];
    if (human && human !== this.main && human !== this.compared) plays.unshift([human, 1]);
    return plays.filter(([play]) => play);
  }

  /* The chosen policy's plan as the controller drove it, where it did. */
  driven(channels) {
    const track = this.accounting === "equal" && this.data.tracks.find((one) => one.policy === this.main.policy);
    if (!track) return [];
    const values = channels({ ego: track.ego })[0].values;
    const known = [...values.keys()].filter((k) => Number.isFinite(values[k]));
    return [{
      name: `${this.data.looks[track.policy].label}, as driven`, label: "", colour: "var(--ink)", dash: "1 4", width: 2,
      x: known.map((k) => this.data.times[k]), y: known.map((k) => values[k]),
    }];
  }

  series(play, width, channels) {
    const look = this.data.looks[play.policy];
    return channels(play).map(({ values, label }, rank) => {
      const known = [...values.keys()].filter((k) => Number.isFinite(values[k]));
      return {
        name: rank || channels(play).length > 1 ? `${look.label}, HV 1` : look.label, label: play === this.main ? label : "", colour: colour(play), dash: look.dashed ? "7 4" : null,
        width: width * 0.8 ** rank,
        x: known.map((k) => this.data.times[k]), y: known.map((k) => values[k]),
      };
    });
  }

  drawCharts() {
    const planned = [this.main, this.compared].filter((p) => p && p.T !== null);
    const marks = planned.map((p, k) => ({ x: p.T, label: k ? "" : "T" }));
    marks.push(...planned.filter((p) => p.start > 0).map((p, k) => ({ x: p.start, label: k ? "" : "start" })));
    for (const { chart, channels, several, ofEgo } of this.charts) {
      const drawn = this.drawn().filter(([play]) => !several || play === this.main || play === this.compared);
      const series = drawn.flatMap(([play, width]) => this.series(play, width, channels));
      chart.draw(ofEgo ? [...series, ...this.driven(channels)] : series, [0, this.data.last], marks);
    }
  }

  drawSurface() {
    if (this.surface) this.surface.draw(this.accounting, choose("quantity").value, this.data.looks);
  }

  drawFits() {
    for (const figure of document.querySelectorAll("[data-fit]")) {
      const fit = this.data.fits[figure.dataset.fit];
      if (!fit) continue;
      const column = Number(figure.dataset.column);
      const line = (packed, name, width, tone) => {
        const { values } = unpack(packed)[column];
        return { name, label: "", colour: tone, width, x: [...values.keys()].map((k) => fit.t0 + k * fit.dt), y: [...values] };
      };
      const chart = new Chart(figure, { title: column ? "Speed" : "Spacing", unit: column ? "m/s" : "m", least: 2 });
      const series = [line(fit.recorded, "Recorded", 2.5, "var(--quiet)"), line(fit.simulated, "LCM", 1.5, "var(--accent)")];
      chart.draw(series, range(series, (s) => s.x, 0.1));
    }
  }

  drawPrediction() {
    const figure = document.getElementById("prediction");
    if (!figure) return;
    const { dt, looks } = this.data.prediction;
    const series = unpack(this.data.prediction).map(({ first, values }, k) => {
      const [name, policy, dashes, heavy, shown] = looks[k];
      return {
        name, label: "", colour: `var(--policy-${policy})`, dash: [null, "4 3", "9 3", "1 3"][dashes], width: heavy ? 2.5 : 1.4, hidden: !shown,
        x: [...values.keys()].map((i) => (first + i) * dt), y: [...values],
      };
    });
    const chart = new Chart(figure, { title: "Speed of HV 1", unit: "m/s", least: 2 });
    chart.draw(series, range(series, (s) => s.x, 0.1));
  }

  drawTracks() {
    for (const figure of document.querySelectorAll("[data-track]")) {
      const [part, column, title, unit] = figure.dataset.track.split("|");
      const series = this.data.tracks.filter((track) => track[part]).map((track) => {
        const { values } = unpack(track[part])[Number(column)];
        const look = this.data.looks[track.policy];
        return {
          name: look.label, label: "", colour: look.colour, dash: look.dashed ? "7 4" : null, width: 1.6,
          x: [...values.keys()].map((k) => k * track.dt), y: [...values],
        };
      });
      const chart = new Chart(figure, { title, unit, digits: 3 });
      chart.draw(series, range(series, (s) => s.x, 0.1));
    }
  }
}

new EventPage(decode(payload("data")));
