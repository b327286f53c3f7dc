/* Plan view of the road: boxes of all vehicles at one moment, seen by a camera that follows the AV. */

const ROAD = { width: SMALL ? 480 : 1120, top: 30, bottom: 34, lateral: 2 };
/* How far behind and ahead of the AV others are kept in view [m]: on a small screen they would be specks. */
const FARTHEST = SMALL ? [-80, 70] : [-190, 160];

class RoadView {
  constructor(svg, data) {
    this.svg = svg;
    this.data = data;
    const { divider, markings } = data;
    this.bottom = Math.max(...markings.filter((y) => y < divider - 1));
    this.top = Math.min(...markings.filter((y) => y > divider + 1));
    this.layer = mark("g");
    this.ground = mark("g");
  }

  /* Fix the stretch of road in view so that the vehicles of these plays stay inside it. */
  frame(plays) {
    const [farthest, ahead] = FARTHEST;
    let back = -50, front = 50;
    const look = (relative) => {
      if (relative > farthest && relative < back) back = relative;
      if (relative < ahead && relative > front) front = relative;
    };
    const ego = plays[0].ego;
    for (let k = 0; k < ego.x.length; k += 5) {
      for (const play of plays) for (const f of play.followers) look(f.x[k] - ego.x[k]);
      for (const other of this.data.others) look(other.x[k] - ego.x[k]);
    }
    this.back = back - 12;
    this.front = front + 12;
    this.scale = ROAD.width / (this.front - this.back);
    this.height = ROAD.top + ROAD.bottom + (this.top - this.bottom) * this.scale * ROAD.lateral;
    this.svg.setAttribute("viewBox", `0 0 ${ROAD.width} ${this.height.toFixed(0)}`);
    this.svg.replaceChildren(this.ground, this.layer);
    this.drawGround();
  }

  y(lateral) {
    return ROAD.top + (this.top - lateral) * this.scale * ROAD.lateral;
  }

  drawGround() {
    const line = (kind, lateral) => mark("line", { class: kind, x1: 0, x2: ROAD.width, y1: this.y(lateral), y2: this.y(lateral) });
    const { divider, markings } = this.data;
    const outermost = (y) => y === markings[0] || y === markings[markings.length - 1];
    const lines = [this.top, this.bottom, divider].map((y) => line(outermost(y) ? "edge" : "marking", y));
    const { ground } = this.data;
    this.picture = ground && mark("image", {
      href: ground.href, preserveAspectRatio: "none", width: ((ground.x[1] - ground.x[0]) * this.scale).toFixed(1),
      y: this.y(ground.y[1]).toFixed(1), height: (this.y(ground.y[0]) - this.y(ground.y[1])).toFixed(1),
    });
    this.ground.replaceChildren(
      ...(this.picture ? [this.picture] : []),
      mark("rect", { class: this.picture ? "lane seen" : "lane", x: 0, width: ROAD.width, y: this.y(this.top), height: this.y(this.bottom) - this.y(this.top) }),
      ...lines);
    this.dashed = lines.filter((element) => element.classList.contains("marking"));
  }

  /* Draw the moment t: boxes of the play in front, outlines and path of the one it is compared with. */
  draw(t, play, compared) {
    const camera = at(play.ego.x, t, this.data.dt);
    if (!Number.isFinite(camera)) return;
    if (this.picture) this.picture.setAttribute("x", this.x(this.data.ground.x[0], camera).toFixed(1));
    for (const line of this.dashed) line.setAttribute("stroke-dashoffset", ((camera * this.scale) % 24).toFixed(1));
    const parts = [...this.distances(camera), this.trail(play, camera), ...this.plan(t, play, camera)];
    if (compared) parts.push(this.trail(compared, camera), ...this.ghosts(t, compared, camera));
    for (const other of this.data.others) {
      parts.push(...this.vehicle(other, this.data.boxes[other.role], t, camera, t > (other.observed - 1) * this.data.dt ? "other predicted" : "other", shortRole(other.role)));
    }
    play.followers.forEach((follower, k) => {
      parts.push(...this.vehicle(follower, this.data.boxes[`target_follower_${k + 1}`], t, camera, "follower", `HV ${k + 1}`));
    });
    parts.push(...this.vehicle(play.ego, this.data.boxes.ego, t, camera, "ego", "AV", `fill: ${colour(play)}`));
    this.layer.replaceChildren(...parts);
  }

  x(along, camera) {
    return (along - camera - this.back) * this.scale;
  }

  distances(camera) {
    const base = this.y(this.bottom);
    const first = Math.ceil((camera + this.back) / 20) * 20;
    const parts = [];
    for (let metre = first; metre < camera + this.front; metre += 20) {
      const x = this.x(metre, camera).toFixed(1);
      parts.push(mark("line", { class: "tick", x1: x, x2: x, y1: base, y2: base + 5 }));
      if (metre % 40 === 0 && x > 22 && x < ROAD.width - 22) parts.push(mark("text", { x, y: base + 18, "text-anchor": "middle" }, `${fixed(metre, 0)} m`));
    }
    return parts;
  }

  vehicle(path, box, t, camera, kind, label, style) {
    const along = at(path.x, t, this.data.dt), lateral = at(path.y, t, this.data.dt);
    const x = this.x(along, camera);
    if (!box || !Number.isFinite(x) || x < -40 || x > ROAD.width + 40) return [];
    const [length, width] = [box[0] * this.scale, box[1] * this.scale * ROAD.lateral];
    const middle = this.y(lateral);
    const parts = [mark("rect", {
      class: kind, x: (x - length / 2).toFixed(1), y: (middle - width / 2).toFixed(1), width: length.toFixed(1),
      height: width.toFixed(1), rx: 3, style,
    })];
    if (label) parts.push(mark("text", { x: x.toFixed(1), y: (middle - width / 2 - 4).toFixed(1), "text-anchor": "middle" }, label));
    return parts;
  }

  ghosts(t, play, camera) {
    const style = `stroke: ${colour(play)}`;
    const boxes = play.followers.map((f, k) => this.vehicle(f, this.data.boxes[`target_follower_${k + 1}`], t, camera, "ghost", "", style));
    return [...boxes.flat(), ...this.vehicle(play.ego, this.data.boxes.ego, t, camera, "ghost", "", style)];
  }

  trail(play, camera) {
    const last = Math.round((play.T === null ? this.data.duration : play.T) / this.data.dt);
    let d = "";
    for (let k = 0; k <= last && k < play.ego.x.length; k++) {
      if (!Number.isFinite(play.ego.x[k])) continue;
      d += `${d ? "L" : "M"}${this.x(play.ego.x[k], camera).toFixed(1)} ${this.y(play.ego.y[k]).toFixed(1)}`;
    }
    return mark("path", { class: "trail", d, style: `stroke: ${colour(play)}` });
  }

  /* The plan that the AV follows at that moment, where it plans anew on the way. */
  plan(t, play, camera) {
    const made = (play.plans || []).filter(([since]) => since <= t + 1e-6).pop();
    if (!made) return [];
    const [, x, y] = made;
    const points = x.map((along, k) => `${this.x(along, camera).toFixed(1)} ${this.y(y[k]).toFixed(1)}`);
    return [mark("path", { class: "plan", d: `M${points.join("L")}`, style: `stroke: ${colour(play)}` })];
  }
}

function shortRole(role) {
  return role.includes("leader") ? "leader" : "follower";
}

function colour(play) {
  return play.colour;
}

/* Value of a channel at time t, between its samples; NaN where it is not in view. */
function at(channel, t, dt) {
  const position = Math.min(Math.max(t / dt, 0), channel.length - 1);
  const k = Math.min(Math.floor(position + 1e-9), channel.length - 1);
  const next = Math.min(k + 1, channel.length - 1);
  return position - k < 1e-6 ? channel[k] : channel[k] + (position - k) * (channel[next] - channel[k]);
}
