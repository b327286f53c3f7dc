"""The gaps on the target lane into which an AV that waits may go, each as a scene of its own at every delay.

Who leads and who follows the AV depends on the gap: behind HV_g, that one leads, by LCM behind the target leader
and untouched by the AV, and HV_(g+1) .. HV_p follow. Ahead of the target leader, whose own leader is not among an
event's roles, the road is taken as free; the target leader then follows the AV by LCM (Table 3 means), and HV_1 ..
HV_p follow it. A target leader that leaves the lane has no gap ahead of it: behind the AV it might have stayed.
The gap behind HV_p is none: nobody knows who comes after it.

Every gap charges the same followers, HV_1 .. HV_p with their weights at t_start, those that the AV lets pass
included; nobody charges the target leader.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.candidates import LossTerms
from highd_lc.algorithms.contacts import NO_CONTACT
from highd_lc.algorithms.packing import PackedScene, obstacle_count
from highd_lc.algorithms.pool import Before
from highd_lc.algorithms.waiting import NEVER, ChainContact, Charges, Waiting, chain_contact, charges
from highd_lc.vocab import names
from highd_lc.vocab.lcm_parameters import REPLAY_L_BOUNDS, TABLE3_MEANS
from highd_lc.vocab.scene import Motion, Scene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Gap:
    """A gap, as the scene that it makes of the event at t_start.

    scene: with the gap's leader as target leader, the vehicles that the AV leaves ahead among the leaders, and the
    vehicles behind the gap as followers; terms: theirs. x, v, a: undisturbed motion of these q followers, shape
    (q, N + 1). passed: followers of the event ahead of the gap; rows: slice of the event's followers among the q.
    charges: beside the manoeuvre; passed_contact: among those who pass. The obstacles keep the order of
    ``packing.obstacle_roles`` in every gap.
    """

    name: str
    scene: PackedScene
    terms: LossTerms
    x: FloatArray
    v: FloatArray
    a: FloatArray
    passed: int
    rows: slice
    charges: Charges
    passed_contact: ChainContact = NEVER

    def opens(self, waiting: Waiting) -> NDArray[np.bool_]:
        """At which samples the AV may start for this gap: its front lies ahead of the follower's, shape (N + 1,).

        A follower behind LCM brakes without measure for a leader whose front is behind its own.
        """
        front = waiting.av.x + self.scene.length / 2.0
        ahead: NDArray[np.bool_] = front > self.x[0] + self.scene.follower_length[0] / 2.0
        return ahead

    def delayed(self, d: int, waiting: Waiting) -> PackedScene:
        """The gap's scene with sample d of the event as its t_start and the AV's place there as its origin."""
        scene, x0 = self.scene, float(waiting.av.x[d])
        origin = scene.origin_follower
        if len(origin):
            origin = np.array([waiting.origin_x[d] - x0, origin[1], waiting.origin_v[d], *origin[3:]])
        return scene._replace(
            v0=float(waiting.av.vx[d]),
            target_front=scene.target_front[d:] - x0,
            target_v=scene.target_v[d:].copy(),
            leader_x=np.ascontiguousarray(scene.leader_x[:, d:]) - x0,
            leader_y=np.ascontiguousarray(scene.leader_y[:, d:]),
            follower_x=self.x[:, d] - x0,
            follower_v=self.v[:, d].copy(),
            origin_follower=origin,
        )


def find_gaps(scene: Scene, packed: PackedScene, terms: LossTerms, waiting: Waiting) -> list[Gap]:
    """The gaps of an event, the recorded one first. packed, terms: of the scene; waiting: in it."""
    found = [_recorded(packed, terms, waiting)]
    found += [_behind(g, packed, terms, waiting) for g in range(1, len(packed.follower_x))]
    if scene.target_leader is not None and not scene.next_leaders:
        found.append(_ahead(scene.target_leader, packed, terms, waiting))
    return found


def _recorded(packed: PackedScene, terms: LossTerms, waiting: Waiting) -> Gap:
    own = charges(waiting, terms, packed.dt, passed=0, counts_insertion=packed.from_crossing)
    return Gap(names.RECORDED_GAP, packed, terms, waiting.x, waiting.v, waiting.a, 0, slice(None), own)


def _behind(g: int, packed: PackedScene, terms: LossTerms, waiting: Waiting) -> Gap:
    """The gap behind HV_g, g >= 1."""
    level = np.repeat(packed.follower_y[:g, None], len(packed.target_v), axis=1)
    parameters, length = packed.parameters[g:].copy(), float(packed.follower_length[g - 1])
    # A fitted L belongs to a leader's length: moved from HV_g's to the AV's (SPEC section 3).
    parameters[0, 5] = np.clip(parameters[0, 5] - length + packed.length, *REPLAY_L_BOUNDS)
    scene = packed._replace(
        target_front=waiting.x[g - 1] + length / 2.0,
        target_v=waiting.v[g - 1].copy(),
        target_length=length,
        leader_x=np.concatenate([packed.leader_x, waiting.x[:g]]),
        leader_y=np.concatenate([packed.leader_y, level]),
        leader_a=np.concatenate([packed.leader_a, packed.follower_a[:g]]),
        leader_b=np.concatenate([packed.leader_b, packed.follower_b[:g]]),
        follower_x=packed.follower_x[g:].copy(),
        follower_y=packed.follower_y[g:].copy(),
        follower_v=packed.follower_v[g:].copy(),
        follower_length=packed.follower_length[g:].copy(),
        follower_a=packed.follower_a[g:].copy(),
        follower_b=packed.follower_b[g:].copy(),
        parameters=parameters,
        first_L=float(packed.parameters[g, 5]),
        weights=packed.weights[g:].copy(),
    )
    later = terms._replace(hv_ref=terms.hv_ref[g:].copy(), weights=terms.weights[g:].copy())
    own = charges(waiting, terms, packed.dt, passed=g, counts_insertion=packed.from_crossing)
    motion = (waiting.x[g:], waiting.v[g:], waiting.a[g:])
    met = chain_contact(waiting.x[:g], packed)
    return Gap(names.gap_behind(g), scene, later, *motion, g, slice(None), own, met)


def _ahead(leader: Motion, packed: PackedScene, terms: LossTerms, waiting: Waiting) -> Gap:
    """The gap ahead of the target leader, who becomes the first follower, without weight."""
    m, samples = len(packed.leader_a) - 1, len(packed.target_v)  # the target leader is the last of the leaders
    parameters = packed.parameters.copy()
    parameters[0, 5] = packed.first_L
    scene = packed._replace(
        target_front=np.full(samples, np.inf),
        target_v=np.zeros(samples),
        target_length=0.0,
        leader_x=packed.leader_x[:m].copy(),
        leader_y=packed.leader_y[:m].copy(),
        leader_a=packed.leader_a[:m].copy(),
        leader_b=packed.leader_b[:m].copy(),
        follower_x=np.append(leader.x[0], packed.follower_x),
        follower_y=np.append(leader.y[0], packed.follower_y),
        follower_v=np.append(leader.v[0], packed.follower_v),
        follower_length=np.append(leader.length, packed.follower_length),
        follower_a=np.append(packed.leader_a[m], packed.follower_a),
        follower_b=np.append(packed.leader_b[m], packed.follower_b),
        parameters=np.vstack([TABLE3_MEANS.as_array(), parameters]),
        first_L=TABLE3_MEANS.L,
        weights=np.append(0.0, packed.weights),
    )
    ahead = terms._replace(hv_ref=np.append(terms.hv_ref[:1], terms.hv_ref), weights=np.append(0.0, terms.weights))
    own = charges(waiting, terms, packed.dt, passed=0, counts_insertion=True)
    motion = (
        np.vstack([leader.x, waiting.x]),
        np.vstack([leader.v, waiting.v]),
        np.vstack([leader.a, waiting.a]),
    )
    return Gap(names.GAP_AHEAD, scene, ahead, *motion, 0, slice(1, None), own)


def before(gap: Gap, d: int, latest: int) -> Before:
    """What a manoeuvre into the gap inherits when it starts at sample d and ends at sample ``latest`` at most."""
    own, scene = gap.charges, gap.scene
    past, roles = gap.passed_contact, obstacle_count(scene)
    # The first contact of those who pass lies at d or later: no start is open after one.
    contact = past.sample - d if past.sample < NO_CONTACT else NO_CONTACT
    role = roles + len(scene.leader_a) - gap.passed + past.follower if past.sample < NO_CONTACT else -1
    charged = float(own.av_before[d]), float(own.hv_before[d])
    return Before(*charged, own.hv_passed[d:], latest - d, contact, role)
