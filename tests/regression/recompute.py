"""Losses and clearances of every plan from the artefacts alone, written from the equations.

Shares no code with the product. Plain numpy and pandas, one event and one plan at a time, under the conventions of
the default settings: recorded leaders, LCM after T, weighted aggregation. Followers are those of
``follower_models`` where that is among the tables, else the fitted ones, which follow the AV from the start and do
nothing else.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pandas as pd

DT = 0.1
JERK, ACCELERATION = 8.0, 8.0  # limits of the AV [m/s^3], [m/s^2]
H = 15.0
V_REF = 33.54
N_COMFORT, N_EFFICIENCY = 8.0, 33.54
TABLE3_MEAN = {"v_desire": 33.54, "A": 4.91, "tau": 0.93, "L": 4.82, "b": 6.93, "B": 6.44}
BARE = {
    "family": "lcm",
    "memory_s": 0.0,
    "relaxation_s": 0.0,
    "need": np.inf,
    "a_0": 0.0,
    "drift": 0.0,
    "moment": 0.0,
}
L_BOUNDS = 2.0, 25.0
B_MAX = 9.0
HUMAN_WINDOW_S = 1.5
# Over which time each side is charged, (AV, followers): True = up to H, False = up to T.
CHARGED_TO_H = {"paper": (False, False), "follower_horizon": (False, True), "equal": (True, True)}
LAST = round(H / DT)
GRID = np.arange(LAST + 1) * DT


@dataclass(frozen=True)
class Vehicle:
    """A vehicle on the 0.1 s grid of 0..H: its box, its recorded motion, extended at constant speed."""

    length: float
    width: float
    x: np.ndarray
    y: np.ndarray
    v: np.ndarray


@dataclass(frozen=True)
class Event:
    """An event's vehicles by role, its followers nearest first with their models, and the ego's recorded path.

    L_unmoved: L of the first follower behind the target leader; crossing: the ego's, in samples.
    """

    D: float
    duration: float
    ego: Vehicle
    others: dict[str, Vehicle]
    leader: Vehicle | None
    followers: list[Vehicle]
    lcm: list[dict[str, float]]
    L_unmoved: float
    path: pd.DataFrame
    crossing: int


@dataclass(frozen=True)
class Drive:
    """The AV on the grid. j: |jx| + |jy| of the prescribed samples; a: LCM commands from the last of them on.

    joins: the sample from which the first follower has it as leader.
    """

    T: float
    x: np.ndarray
    vx: np.ndarray
    y: np.ndarray
    vy: np.ndarray
    j: np.ndarray
    a: np.ndarray
    joins: int


# --- the scene ---------------------------------------------------------------------------------------------------


def on_grid(track: pd.DataFrame, box: pd.Series) -> Vehicle:
    """Recorded motion on the grid: cubic Hermite for positions, linear speeds, constant speed out of view."""
    t = track["t"].to_numpy()
    seen = np.clip(GRID, t[0], t[-1])
    i = np.clip(np.searchsorted(t, seen + 1e-9) - 1, 0, len(t) - 2)
    h = t[i + 1] - t[i]
    u = (seen - t[i]) / h

    def hermite(position: str, speed: str) -> np.ndarray:
        p, s = track[position].to_numpy(), track[speed].to_numpy()
        basis = ((1 + 2 * u) * (1 - u) ** 2, u * (1 - u) ** 2, u**2 * (3 - 2 * u), u**2 * (u - 1))
        return basis[0] * p[i] + basis[1] * h * s[i] + basis[2] * p[i + 1] + basis[3] * h * s[i + 1]

    v = np.interp(seen, t, track["vx"].to_numpy())
    return Vehicle(box["length"], box["width"], hermite("x", "vx") + v * (GRID - seen), hermite("y", "vy"), v)


def read_event(tables: dict[str, pd.DataFrame], event_id: str, model: str = "population") -> Event:
    """One event on the grid. model: which of ``follower_models`` its followers drive by."""
    event = tables["events"].set_index("event_id").loc[event_id]
    rows = tables["event_tracks"][tables["event_tracks"]["event_id"] == event_id].sort_values("t")
    of_recording = tables["vehicles"]["recording_id"] == event["recording_id"]
    boxes = tables["vehicles"][of_recording].set_index("vehicle_id")
    from_start = rows[rows["t"] > -1e-9]
    cars = {
        role: on_grid(track, boxes.loc[track["vehicle_id"].iloc[0]]) for role, track in from_start.groupby("role")
    }
    drivers, unmoved = (
        modelled(tables, event_id, model) if "follower_models" in tables else fitted(tables, event_id, cars)
    )
    ego = cars.pop("ego")
    followers = [cars.pop(f"target_follower_{rank + 1}") for rank in range(len(drivers))]
    path = rows[rows["role"] == "ego"]
    leader = leading(cars, event)
    crossing = round((event["crossing_frame"] - event["start_frame"]) / event["frame_rate"] / DT)
    return Event(
        event["lateral_shift_m"],
        event["duration_s"],
        ego,
        cars,
        leader,
        followers,
        drivers,
        unmoved,
        path,
        crossing,
    )


def fitted(tables: dict[str, pd.DataFrame], event_id: str, cars: dict[str, Vehicle]) -> tuple[list[dict], float]:
    """The fitted LCM of each follower, and L of the first one behind the target leader."""
    fits = tables["followers"][tables["followers"]["event_id"] == event_id].sort_values("follower")
    drivers = [
        BARE | {name: row[name] for name in ("v_desire", "A", "b", "B", "tau")} | {"L": row["L_replay"]}
        for _, row in fits.iterrows()
    ]
    unmoved = fits.iloc[0]["L"]
    if "target_leader" in cars and np.isfinite(fits.iloc[0]["leader_length_m"]):
        moved = unmoved - fits.iloc[0]["leader_length_m"] + cars["target_leader"].length
        unmoved = min(max(moved, L_BOUNDS[0]), L_BOUNDS[1])
    return drivers, unmoved


def modelled(tables: dict[str, pd.DataFrame], event_id: str, model: str) -> tuple[list[dict], float]:
    """The same of a follower model."""
    rows = tables["follower_models"]
    rows = rows[(rows["event_id"] == event_id) & (rows["model"] == model)].sort_values("follower")
    return rows.to_dict("records"), rows.iloc[0]["L_before"]


def leading(cars: dict[str, Vehicle], event: pd.Series) -> Vehicle | None:
    """Who leads the target lane at each sample, with its rear where it is and the length of the first one."""
    first = cars.get("target_leader")
    if first is None:
        return None
    x, v = first.x.copy(), first.v.copy()
    for rank, change in enumerate(event["leader_changes_s"], start=2):
        after, later = change - 1e-6 < GRID, cars.get(f"target_leader_{rank}")
        x[after], v[after] = np.inf, 0.0
        if later is not None:
            x[after], v[after] = later.x[after] + (first.length - later.length) / 2, later.v[after]
    return replace(first, x=x, v=v)


# --- motion ------------------------------------------------------------------------------------------------------


def desired(p: dict[str, float], v: float, v_leader: float) -> float:
    """Desired spacing of the LCM; of the IDM its gap at a common speed."""
    if p.get("family") == "idm":
        return p["L"] + v * p["tau"]
    return max(v**2 / (2 * p["b"]) - v_leader**2 / (2 * p["B"]) + v * p["tau"] + p["L"], p["L"])


def lcm_acceleration(p: dict[str, float], v: float, leader: tuple[float, float] | None) -> float:
    """LCM [10-11], braking bounded. leader: its spacing front to front and its speed; None = free road."""
    s, v_leader = leader or (np.inf, 0.0)
    exponent = min(1 - s / desired(p, v, v_leader), 40.0)
    return max(p["A"] * (1 - v / p["v_desire"] - np.exp(exponent)), -B_MAX)


def command(p: dict[str, float], v: float, s: float, v_leader: float, length: float) -> float:
    """What a model's family asks for behind a leader of that length; s: spacing, infinite = free road."""
    if p["family"] == "none":
        return 0.0
    if p["family"] == "lcm":
        return p["A"] * (1 - v / p["v_desire"] - np.exp(min(1 - s / desired(p, v, v_leader), 40.0)))
    wanted = p["L"] + max(0.0, v * p["tau"] + v * (v - v_leader) / (2 * np.sqrt(p["A"] * p["b"])))
    return p["A"] * (1 - (v / p["v_desire"]) ** 4 - (wanted / max(s - length, 0.1)) ** 2)


@dataclass
class Driver:
    """A follower at the wheel. credit: jump of spacing and speed at its change of leader, at sample ``since``."""

    credit: tuple[float, float] = (0.0, 0.0)
    since: int = 0

    def changes(self, p: dict[str, float], k: int, v: float, new: tuple, old: tuple) -> None:
        """At sample k its leader becomes another. new, old: spacing and speed of both; infinite = none."""
        wanted = desired(p, v, new[1])
        had, jump_v = (wanted, 0.0) if np.isinf(old[0]) else (min(old[0], 2 * wanted), old[1] - new[1])
        self.credit, self.since = (max(had - new[0], 0.0), jump_v), k

    def decides(self, p: dict[str, float], k: int, v: float, leader: tuple[float, float, float]) -> float:
        """Its command k samples after t_start. leader: spacing, speed and length."""
        s, v_leader, length = leader
        left = max(1 - (k - self.since) * DT / p["relaxation_s"], 0.0) if p["relaxation_s"] > 0 else 0.0
        seen = s + left * self.credit[0], max(v_leader + left * self.credit[1], 0.0)
        m = np.exp(-k * DT / p["memory_s"]) if p["memory_s"] > 0 else 0.0
        a = m * p["a_0"] + (1 - m) * (command(p, v, *seen, length) + p["drift"])
        required = max(v - v_leader, 0.0) ** 2 / (2 * max(s - length - 1.0, 0.1))
        return max(min(a, -required) if required > p["need"] else a, -B_MAX)


def quintic(times: np.ndarray, plan: pd.Series, v0: float, D: float) -> dict[str, np.ndarray]:
    """The AV's trajectory [1-4] and its derivatives at times within 0..T, from the polynomials' coefficients."""
    T = plan["T"]
    z = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    q = np.polynomial.Polynomial([0, 0, 0, -4, 7, -3])
    x = np.polynomial.Polynomial([0, v0 * T]) + (plan["x_final"] - v0 * T) * z + T * (plan["v_end"] - v0) * q
    motion = {}
    for order, name in enumerate(("", "v", "a", "j")):
        for axis, shape in (("x", x), ("y", D * z)):
            motion[name + axis] = (shape.deriv(order) if order else shape)(times / T) / T**order
    return motion


def human_path(event: Event) -> dict[str, np.ndarray]:
    """The recorded path over the grid's samples while in view: local cubics over the window, fitted anew.

    Near the ends of the track the cubic of the last whole window serves.
    """
    t = event.path["t"].to_numpy()
    rate = round(1 / np.median(np.diff(t)), 6)
    half = min(round(HUMAN_WINDOW_S * rate / 2), (len(t) - 1) // 2)
    motion = {}
    for axis in ("x", "y"):
        values = event.path[axis].to_numpy()
        smooth = np.empty((4, len(t)))
        for i in range(len(t)):
            c = min(max(i, half), len(t) - 1 - half)
            cubic = np.polynomial.Polynomial.fit(t[c - half : c + half + 1], values[c - half : c + half + 1], 3)
            smooth[:, i] = [(cubic.deriv(k) if k else cubic)(t[i]) for k in range(4)]
        last = max(round(event.duration / DT), int(t[-1] / DT + 1e-6))
        times = GRID[: last + 1]
        for name, row in zip(("", "v", "a", "j"), smooth, strict=True):
            motion[name + axis] = np.interp(times, t, row)
    return motion


def drive(event: Event, plan: pd.Series) -> Drive:
    """The AV over 0..H: as prescribed until T, the human while in view, then LCM behind who leads the target lane
    (Table 3 means).
    """
    n = round(plan["T"] / DT)
    human = plan["policy"] == "human"
    m = human_path(event) if human else quintic(GRID[: n + 1], plan, event.ego.v[0], event.D)
    n = len(m["x"]) - 1
    x, vx, y, vy = (np.zeros(LAST + 1) for _ in range(4))
    x[: n + 1], vx[: n + 1], y[: n + 1], vy[: n + 1] = m["x"], m["vx"], m["y"], m["vy"]
    y[n:] = m["y"][-1]
    before = m["ax"][-1] if human else 0.0
    a = follow_leader(event, x, vx, n, event.leader, before=before)
    # The step onto the drive counts where there is a drive.
    a = np.append(before, a) if n < LAST else a
    joins = joining(event.lcm[0]["moment"], y / event.D, None if human else n // 2)
    return Drive(plan["T"], x, vx, y, vy, np.abs(m["jx"]) + np.abs(m["jy"]), a, joins)


def joining(moment: float, made: np.ndarray, crossing: int | None) -> int:
    """First sample at which the AV has made that share of its lateral way; half of a plan's is its crossing."""
    if moment == 0.0:
        return 0
    if moment == 0.5 and crossing is not None:
        return crossing
    return int(np.argmax(made >= moment - 1e-9)) if (made >= moment - 1e-9).any() else LAST + 1


def gentle(a: float, before: float) -> float:
    """What a car with the AV's limits of jerk and acceleration makes of a command, a sample after another one."""
    return min(max(a, before - JERK * DT, -ACCELERATION), before + JERK * DT, ACCELERATION)


def follow_leader(
    event: Event, x: np.ndarray, vx: np.ndarray, n: int, leader: Vehicle | None, *, before: float
) -> np.ndarray:
    """The AV by LCM from sample n on, filled into x and vx; its commands from there. before: the one before."""
    a = np.empty(LAST - n + 1)
    for k in range(n, LAST + 1):
        ahead = None
        if leader is not None:
            ahead = leader.x[k] - x[k] + (leader.length - event.ego.length) / 2, leader.v[k]
        a[k - n] = gentle(lcm_acceleration(TABLE3_MEAN, vx[k], ahead), a[k - n - 1] if k > n else before)
        if k < LAST:
            vx[k + 1] = max(vx[k] + a[k - n] * DT, 0.0)
            x[k + 1] = x[k] + vx[k + 1] * DT
    return a


def follow(event: Event, first: tuple[np.ndarray, np.ndarray, float], joins: int) -> list[dict[str, np.ndarray]]:
    """The followers over 0..H, each behind the one before it, the first behind x, v, length of ``first`` from
    sample ``joins`` on and behind who leads the target lane before.

    All use the states of the same instant.
    """
    cars = event.followers
    leader = (np.full(LAST + 1, np.inf), np.zeros(LAST + 1), 0.0)
    if event.leader is not None:
        leader = event.leader.x, event.leader.v, event.leader.length
    x = [np.full(LAST + 1, car.x[0]) for car in cars]
    v = [np.full(LAST + 1, car.v[0]) for car in cars]
    a = [np.zeros(LAST + 1) for _ in cars]
    drivers = [Driver() for _ in cars]
    for k in range(LAST + 1):
        for i, car in enumerate(cars):

            def ahead(other: tuple, k: int = k, i: int = i, car: Vehicle = car) -> tuple[float, float, float]:
                return other[0][k] - x[i][k] + (other[2] - car.length) / 2, other[1][k], other[2]

            before, p = (x[i - 1], v[i - 1], cars[i - 1].length), event.lcm[i]
            if i == 0:
                before = first if k >= joins else leader
                p = p if k >= joins else p | {"L": event.L_unmoved}
            if i == 0 and k == joins:
                drivers[0].changes(p, k, v[0][k], ahead(first)[:2], ahead(leader)[:2])
            a[i][k] = drivers[i].decides(p, k, v[i][k], ahead(before))
        if k < LAST:
            for i in range(len(cars)):
                v[i][k + 1] = max(v[i][k] + a[i][k] * DT, 0.0)
                x[i][k + 1] = x[i][k] + v[i][k + 1] * DT
    return [{"x": x[i], "v": v[i], "a": a[i]} for i in range(len(cars))]


def behind(event: Event, av: Drive) -> list[dict[str, np.ndarray]]:
    """The followers, the first one behind the AV once it joins."""
    return follow(event, (av.x, av.vx, event.ego.length), av.joins)


def unchanged(event: Event) -> list[dict[str, np.ndarray]]:
    """The followers without a lane change: the first stays behind the target leader."""
    nobody = np.full(LAST + 1, np.inf)
    return follow(event, (nobody, np.zeros(LAST + 1), 0.0), LAST + 1)


# --- losses ------------------------------------------------------------------------------------------------------


def weights(event: Event) -> np.ndarray:
    """Equations 16, 17: speed difference over the root of the spacing to the AV at t_start; alike without one."""
    ego = event.ego
    spacing = np.array([ego.x[0] - car.x[0] + (ego.length - car.length) / 2 for car in event.followers])
    spacing[spacing <= 0.0] = np.nan
    sigma = np.array([abs(car.v[0] - ego.v[0]) for car in event.followers]) / np.sqrt(spacing)
    return sigma / sigma.sum() if sigma.sum() > 0 else np.full(len(sigma), 1 / len(sigma))


def av_loss(av: Drive, accounting: str) -> dict[str, float]:
    """The AV's normalised comfort and efficiency."""
    to_h = CHARGED_TO_H[accounting][0]
    end = LAST if to_h else round(av.T / DT)
    comfort = av.j[: end + 1].sum() + (np.abs(np.diff(av.a)).sum() / DT if to_h else 0.0)
    efficiency = np.abs(np.hypot(av.vx[: end + 1], av.vy[: end + 1]) - V_REF).sum()
    comfort, efficiency = comfort / N_COMFORT, efficiency / N_EFFICIENCY
    return {"av_comfort": comfort, "av_efficiency": efficiency, "loss_av": 0.5 * comfort + 0.5 * efficiency}


def hv_loss(event: Event, motion: list[dict[str, np.ndarray]], T: float, accounting: str) -> dict[str, float]:
    """The followers' normalised, weighted comfort and efficiency."""
    end = LAST if CHARGED_TO_H[accounting][1] else round(T / DT)
    comfort = weights(event) @ [np.abs(np.diff(m["a"][: end + 1])).sum() / DT / N_COMFORT for m in motion]
    efficiency = weights(event) @ [np.abs(m["v"][: end + 1] - V_REF).sum() / N_EFFICIENCY for m in motion]
    return {"hv_comfort": comfort, "hv_efficiency": efficiency, "loss_hv": 0.5 * comfort + 0.5 * efficiency}


def in_view(tables: dict[str, pd.DataFrame], event_id: str, event: Event, speeds: list[np.ndarray]) -> float:
    """The followers' weighted loss while each is filmed in its lane behind the recorded ego and all between.

    At most 8 s. Comfort is that of the mean of 11 speeds in a row. NaN where nobody is in view for 13 samples.
    """
    rows = tables["event_tracks"][tables["event_tracks"]["event_id"] == event_id]
    last, total = 81, np.nan
    for rank in range(len(event.followers) + 1):
        role = f"target_follower_{rank}" if rank else "ego"
        last = min(last, int(rows.loc[rows["role"] == role, "t"].max() / DT + 1e-6) + 1)
        if not rank:
            continue
        away = np.abs(event.followers[rank - 1].y - event.followers[rank - 1].y[0]) > 1.9
        last = min(last, int(np.argmax(away))) if away.any() else last
        if last >= 13:
            v = speeds[rank - 1][:last]
            smooth = np.convolve(v, np.full(11, 1 / 11), "valid")
            comfort = np.abs(np.diff(smooth, n=2)).sum() / DT**2 / N_COMFORT
            one = 0.5 * comfort + 0.5 * np.abs(v - V_REF).sum() / N_EFFICIENCY
            total = np.nan_to_num(total) + weights(event)[rank - 1] * one
    return total


def plan_losses(event: Event, plan: pd.Series) -> dict[str, float]:
    """Every loss of one plan; of "no_lane_change" the followers' alone."""
    if plan["policy"] == "no_lane_change":
        return hv_loss(event, unchanged(event), plan["T"], plan["accounting"])
    av = drive(event, plan)
    motion = behind(event, av)
    return av_loss(av, plan["accounting"]) | hv_loss(event, motion, plan["T"], plan["accounting"])


def drives_through(event: Event, plan: pd.Series, crossing: int) -> bool:
    """Whether a front gets past the rear of the vehicle ahead on the target lane within the accounted time.

    crossing: the sample from which the AV is on that lane.
    """
    av = drive(event, plan)
    motion = behind(event, av)
    cars = [(car, m["x"]) for car, m in zip(event.followers, motion, strict=True)]
    leader = event.leader  # who leads at each sample, as leaders leave the lane
    own, ahead = (event.ego, av.x), (None if leader is None else (leader, leader.x))
    end = (round(av.T / DT) if plan["accounting"] == "paper" else LAST) + 1
    chain = [(before, after, 0, end) for before, after in pairwise(cars)]
    chain.append((own, cars[0], crossing, end))
    if ahead is not None:
        chain += [(ahead, own, crossing, end), (ahead, cars[0], 0, min(crossing, end))]
    return any(
        (before[1] - after[1] - (before[0].length + after[0].length) / 2 < 0)[first:stop].any()
        for before, after, first, stop in chain
    )


# --- constraints -------------------------------------------------------------------------------------------------


def separation(
    centres: np.ndarray, axes: tuple[float, float], headings: np.ndarray, other: tuple[float, float], *, n: int
) -> np.ndarray:
    """Distance of two ellipses at every sample by brute force over n directions; the other is not turned.

    The distance of two convex sets is the largest separation over all directions u, u . (c2 - c1) - h1(u) - h2(u),
    with each one's support function h; negative when they overlap. Fewer directions give a lower bound.
    """
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    own = np.hypot(axes[0] * np.cos(angle - headings[:, None]), axes[1] * np.sin(angle - headings[:, None]))
    reach = own + np.hypot(other[0] * np.cos(angle), other[1] * np.sin(angle))
    return (centres[:, :1] * np.cos(angle) + centres[:, 1:] * np.sin(angle) - reach).max(axis=1)


def safety_slack(event: Event, plan: pd.Series) -> dict[str, float]:
    """By how much a plan that starts at once keeps each constraint of the default safety profile."""
    av, n = drive(event, plan), round(plan["T"] / DT)
    chain, leader = behind(event, av), event.leader
    first = chain[0]
    length, car = event.ego.length, event.followers[0]
    gap = av.x - first["x"] - (length + car.length) / 2
    closing = max(first["v"][0] - av.vx[0], 0.0)
    critical = closing * 0.4 + closing**2 / 6.0 + av.vx[0] if closing else 0.0
    pairs = {"behind": (gap, first["v"], av.vx)}
    if leader is not None:
        pairs["ahead"] = (leader.x - av.x - (leader.length + length) / 2, av.vx, leader.v)
    slack = {"start": gap[0] - critical, "acceleration": ACCELERATION - np.abs(av.a).max()}
    slack["jerk"] = JERK - np.abs(np.diff(av.a)).max(initial=0.0) / DT
    for name, (apart, v, v_leader) in pairs.items():
        used = slice(n // 2, None)
        slack[f"time gap {name}"] = np.nanmin((apart - 0.5 * v)[used])
        slack[f"drac {name}"] = np.nanmin((2 * 3.35 * apart - np.maximum(v - v_leader, 0.0) ** 2)[used])
    for i, (one, other) in enumerate(pairwise(zip(chain, event.followers, strict=True)), start=2):
        apart = one[0]["x"] - other[0]["x"] - (one[1].length + other[1].length) / 2
        slack[f"gap of follower {i}"] = apart.min() - 0.3
    return slack


def smallest_clearance(event: Event, plan: pd.Series) -> float:
    """Smallest distance between the AV's ellipse and anybody's over the accounted samples."""
    av = drive(event, plan)
    n = round(av.T / DT)
    end = n if plan["accounting"] == "paper" else LAST
    heading, r = np.arctan2(av.vy, av.vx), 0.3 * event.ego.length
    x, y = av.x - r + r * np.cos(heading), av.y + r * np.sin(heading)
    motion = behind(event, av)
    found = [
        (event.others[role], event.others[role].x, event.others[role].y, end)
        for role in event.others
        if "leader" in role
    ]
    found += [
        (car, m["x"], np.full(LAST + 1, car.y[0]), end) for car, m in zip(event.followers, motion, strict=True)
    ]
    if "origin_follower" in event.others:
        car = event.others["origin_follower"]
        alone = replace(event, followers=[car], lcm=[BARE | TABLE3_MEAN])
        later = follow(alone, (av.x, av.vx, event.ego.length), 0)[0]["x"]
        found.append((car, later, np.full(LAST + 1, car.y[0]), n // 2))
    axes = event.ego.length / 2**0.5, event.ego.width / 2**0.5
    return min(
        nearest(np.column_stack([other_x - x, other_y - y])[: last + 1], axes, heading[: last + 1], car)
        for car, other_x, other_y, last in found
    )


def nearest(centres: np.ndarray, axes: tuple[float, float], heading: np.ndarray, car: Vehicle) -> float:
    """Smallest distance over all samples: roughly first, then well where it is close."""
    other = car.length / 2**0.5, car.width / 2**0.5
    roughly = separation(centres, axes, heading, other, n=120)
    # What 120 directions may miss of the distance, rounded up: |c| (1 - cos of half their step).
    close = roughly <= roughly.min() + 0.02 + 4e-4 * np.hypot(*centres.T)
    return float(separation(centres[close], axes, heading[close], other, n=4000).min())
