"""Losses and clearances of the plans that choose their start, from the artefacts alone.

Everybody is simulated together from t_start on, one instant at a time: the AV at constant speed on its lane until
its start, the followers behind the target leader until the one behind the gap gets the AV as its leader, and the
target leader by LCM once the AV is ahead of it. Conventions of the default settings.
"""

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from recompute import (
    BARE,
    CHARGED_TO_H,
    DT,
    GRID,
    L_BOUNDS,
    LAST,
    N_COMFORT,
    N_EFFICIENCY,
    TABLE3_MEAN,
    V_REF,
    Driver,
    Event,
    Vehicle,
    gentle,
    joining,
    nearest,
    quintic,
    weights,
)

AHEAD = "ahead_of_target_leader"


@dataclass
class Car:
    """A vehicle on its way: states and commands at all samples so far. lcm: None = as recorded."""

    box: Vehicle
    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    lcm: dict[str, float] | None
    driver: Driver = field(default_factory=Driver)

    def ahead(self, k: int, leader: "Car | None") -> tuple[float, float, float]:
        if leader is None:
            return np.inf, 0.0, 0.0
        spacing = leader.x[k] - self.x[k] + (leader.box.length - self.box.length) / 2
        return spacing, leader.v[k], leader.box.length

    def think(self, k: int, leader: "Car | None") -> None:
        self.a[k] = self.driver.decides(self.lcm, k, self.v[k], self.ahead(k, leader))

    def change(self, k: int, new: "Car", old: "Car | None") -> None:
        self.driver.changes(self.lcm, k, self.v[k], self.ahead(k, new)[:2], self.ahead(k, old)[:2])

    def move(self, k: int) -> None:
        self.v[k + 1] = max(self.v[k] + self.a[k] * DT, 0.0)
        self.x[k + 1] = self.x[k] + self.v[k + 1] * DT


@dataclass
class Played:
    """Everybody under a plan. d, end: samples of the manoeuvre's start and end; joined: follower behind the AV.

    inserted: whether that one gets it as leader at once, so that the step of its command is not counted.
    """

    av: Car
    y: np.ndarray
    vy: np.ndarray
    j: np.ndarray
    chain: list[Car]
    target: Car | None
    d: int
    end: int
    joined: int
    inserted: bool


def starting(box: Vehicle, lcm: dict[str, float] | None) -> Car:
    columns = (np.full(LAST + 1, box.x[0]), np.full(LAST + 1, box.v[0])) if lcm else (box.x.copy(), box.v.copy())
    return Car(box, *columns, np.zeros(LAST + 1), lcm)


def play(event: Event, plan: pd.Series) -> Played:
    """Everybody over 0..H."""
    d, n = round(plan["delay_s"] / DT), round(plan["T"] / DT)
    passed = int(plan["gap"].rsplit("_", 1)[1]) if plan["gap"].startswith("behind") else 0
    joined = -1 if plan["gap"] == AHEAD else passed
    m = quintic(GRID[: n + 1], plan, plan["v_start"], event.D)
    av = starting(event.ego, BARE | TABLE3_MEAN)
    moment = event.lcm[max(joined, 0)]["moment"]
    joins = d + joining(moment, m["y"] / event.D, n // 2)
    leader = event.leader
    target = None if leader is None else starting(leader, None)
    chain = [starting(car, dict(lcm)) for car, lcm in zip(event.followers, event.lcm, strict=True)]
    behind_av = dict(event.lcm[max(joined, 0)])
    if passed and behind_av["family"] == "lcm":
        moved = behind_av["L"] - event.followers[passed - 1].length + event.ego.length
        behind_av["L"] = min(max(moved, L_BOUNDS[0]), L_BOUNDS[1])
    chain[0].lcm["L"] = event.L_unmoved
    before_av = None if joined < 0 else chain[passed - 1] if passed else target
    for k in range(LAST + 1):
        if k == d:
            av.x[d : d + n + 1], av.v[d : d + n + 1] = av.x[d] + m["x"], m["vx"]
            if joined < 0 and target is not None:
                target.lcm = BARE | TABLE3_MEAN
        if k == joins and joined >= 0:
            chain[joined].lcm = behind_av
            chain[joined].change(k, av, before_av)
        for i, car in enumerate(chain):
            own = chain[i - 1] if i else target
            car.think(k, av if i == joined and k >= joins else own)
        if k >= d + n:
            av.think(k, before_av)
            av.a[k] = gentle(av.a[k], av.a[k - 1])
        if target is not None and target.lcm is not None:
            target.think(k, av if k >= joins else None)
        if k < LAST:
            for car in (*chain, *([target] if target is not None and target.lcm is not None else [])):
                car.move(k)
            if k < d:
                av.x[k + 1] = av.x[k] + av.v[k] * DT
            elif k >= d + n:
                av.move(k)
    y, vy = np.zeros(LAST + 1), np.zeros(LAST + 1)
    y[d : d + n + 1], vy[d : d + n + 1] = m["y"], m["vy"]
    y[d + n :] = m["y"][-1]
    return Played(av, y, vy, np.abs(m["jx"]) + np.abs(m["jy"]), chain, target, d, d + n, joined, moment == 0.0)


def start_losses(event: Event, plan: pd.Series) -> dict[str, float]:
    """Every loss of a plan that chooses its start."""
    p = play(event, plan)
    av_to_h, hv_to_h = CHARGED_TO_H[plan["accounting"]]
    av_end, hv_end = LAST if av_to_h else p.end, LAST if hv_to_h else p.end
    # Its drive begins with the step from the plan's 0.
    driven = p.av.a[p.end - 1 :] if p.end < LAST else p.av.a[p.end :]
    steps = np.abs(np.diff(driven)).sum() / DT if av_to_h else 0.0
    av_comfort = (p.j.sum() + steps) / N_COMFORT
    av_efficiency = np.abs(np.hypot(p.av.v, p.vy)[: av_end + 1] - V_REF).sum() / N_EFFICIENCY
    jerk = []
    for i, car in enumerate(p.chain):
        each = np.abs(np.diff(car.a[: hv_end + 1])) / DT
        if i == p.joined and p.inserted and 0 < p.d <= hv_end:
            each[p.d - 1] = 0.0  # the step at the insertion is not counted
        jerk.append(each.sum() / N_COMFORT)
    hv_comfort = weights(event) @ jerk
    hv_efficiency = weights(event) @ [np.abs(car.v[: hv_end + 1] - V_REF).sum() / N_EFFICIENCY for car in p.chain]
    av, hv = 0.5 * (av_comfort + av_efficiency), 0.5 * (hv_comfort + hv_efficiency)
    return {
        "av_comfort": av_comfort, "av_efficiency": av_efficiency, "loss_av": av,
        "hv_comfort": hv_comfort, "hv_efficiency": hv_efficiency, "loss_hv": hv, "loss_total": av + hv,
    }  # fmt: skip


def start_clearance(event: Event, plan: pd.Series) -> float:
    """Smallest distance between the AV's ellipse and anybody's over the accounted samples, waiting included."""
    p = play(event, plan)
    last = p.end if plan["accounting"] == "paper" else LAST
    heading, r = np.arctan2(p.vy, p.av.v), 0.3 * event.ego.length
    x, y = p.av.x - r + r * np.cos(heading), p.y + r * np.sin(heading)
    found = [(car.box, car.x, np.full(LAST + 1, car.box.y[0]), last) for car in p.chain]
    recorded = {role: car for role, car in event.others.items() if "leader" in role}
    if p.joined < 0 and p.target is not None:
        del recorded["target_leader"]
        found.append((p.target.box, p.target.x, np.full(LAST + 1, p.target.box.y[0]), last))
    found += [(car, car.x, car.y, last) for car in recorded.values()]
    if "origin_follower" in event.others:
        behind = starting(event.others["origin_follower"], BARE | TABLE3_MEAN)
        for k in range(LAST):
            behind.think(k, p.av)
            behind.move(k)
        crossing = p.d + (p.end - p.d) // 2
        found.append((behind.box, behind.x, np.full(LAST + 1, behind.box.y[0]), crossing))
    axes = event.ego.length / 2**0.5, event.ego.width / 2**0.5
    return min(
        nearest(np.column_stack([other_x - x, other_y - y])[: end + 1], axes, heading[: end + 1], car)
        for car, other_x, other_y, end in found
    )
