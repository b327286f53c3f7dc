"""The compiled candidates against their twin in plain numpy, under every convention."""

from dataclasses import replace

import numpy as np
import planner_twin
import pytest
from random_scenes import random_scene, reacting, task_of

from highd_lc.planning.candidates import evaluate
from highd_lc.planning.contacts import contact_words
from highd_lc.planning.scene import obstacle_roles
from highd_lc.vocab import names
from highd_lc.vocab.settings import ValidateSettings

DURATIONS = np.array([20, 31, 47, 64, 83, 100])


def candidates(seed: int, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """delta and change of plans that keep a positive speed, the unaccelerated one among them; not whole tiles."""
    rng = np.random.default_rng(seed)
    T = DURATIONS[:, None] * 0.1
    change = rng.uniform(-3, 3, (len(DURATIONS), count))
    delta = change * T / 2 + rng.uniform(-0.25, 0.25, change.shape) * T**2
    delta[:, 0] = change[:, 0] = 0.0
    return delta, change


def compared(scene, settings=None, seed=0, *, count=40):
    task = task_of(scene, settings)
    arguments = (DURATIONS, *candidates(seed, count), task.scene, task.terms)
    return evaluate(*arguments), planner_twin.evaluate(*arguments)


def at_rest(motion, x):
    return None if motion is None else replace(motion, x=np.full(len(motion.x), x), v=0.0 * motion.v)


def check(found, wanted):
    for name in ("av_T", "av_H", "hv_T", "hv_H"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), rtol=1e-10, err_msg=name)
    np.testing.assert_array_equal(found.contact, wanted.contact)
    np.testing.assert_array_equal(found.role, wanted.role)
    np.testing.assert_array_equal(found.unsafe, wanted.unsafe)


@pytest.mark.parametrize("seed", range(12))
def test_losses_and_contacts_are_those_of_the_twin(seed):
    scene = random_scene(np.random.default_rng(seed), p=1 + seed % 4, crowding=1.0 + seed % 3)
    found, wanted = compared(scene, seed=seed)
    check(found, wanted)


def test_contacts_with_everybody_are_those_of_the_twin():
    met = set()
    for seed in range(12):
        scene = random_scene(np.random.default_rng(seed), p=2, crowding=3.0)
        # So much faster than the AV that the LCM cannot brake in time.
        rushing = replace(scene, followers=replace(scene.followers, v=scene.followers.v + np.array([18.0, 25.0])))
        # A leader that stands just ahead of HV_1, while the AV is still beside it.
        standing = replace(scene, target_leader=at_rest(scene.target_leader, scene.followers.x[0] + 9.0))
        for one in (scene, rushing, standing):
            # A margin around the ellipses would be broken before the AV is through its leader.
            settings = ValidateSettings.model_validate({"safety": {"profile": "paper"}})
            found, wanted = compared(one, settings, count=15)
            np.testing.assert_array_equal(found.contact, wanted.contact)
            np.testing.assert_array_equal(found.role, wanted.role)
            words = contact_words(obstacle_roles(one))
            met |= {words[i] for i in np.unique(found.role) if i >= 0}
    roles = (names.ORIGIN_LEADER, names.TARGET_LEADER, names.target_follower(1), names.ORIGIN_FOLLOWER)
    assert met >= {f"clearance_{role}" for role in roles}
    first, second = names.target_follower(1), names.target_follower(2)
    pairs = ((second, first), (first, names.TARGET_LEADER), (names.EGO, names.TARGET_LEADER))
    assert met >= {f"contact_{names.through(*pair)}" for pair in pairs}


@pytest.mark.parametrize(
    "section",
    [
        {"planner": {"after": "constant"}},
        {"planner": {"leader_from": "crossing"}},
        {"loss": {"reference": "one-sided"}},
        {"loss": {"reference": "own"}},
        {"loss": {"aggregation": "sum"}},
        {"loss": {"handover": "counted"}},
        {"loss": {"comfort_scale": 3.0, "efficiency_scale": 25.0, "v_ref_av": 30.0, "v_ref_hv": 25.0}},
        {"constraints": {"ellipse": "paper"}},
        {"constraints": {"contacts": "av"}},
        {"safety": {"profile": "paper"}},
        {"safety": {"time_gap_s": 1.2, "braking": 0.0, "clearance_m": 1.0}},
        {"safety": {"drac": 0.2, "time_gap_s": 0.0, "braking_gap_s": 0.1}},
        {"constraints": {"v_max": 30.0, "acceleration": 2.0, "jerk": 1.0}},
        {"followers": {"b_max": 0.0}},
        {"followers": {"b_max": 3.0}, "planner": {"leader_from": "crossing"}},
    ],
    ids=lambda section: "-".join(f"{k}={v}" for fields in section.values() for k, v in fields.items()),
)
def test_every_convention_has_the_same_twin(section):
    scene = random_scene(np.random.default_rng(3))
    check(*compared(scene, ValidateSettings.model_validate(section)))


@pytest.mark.parametrize("moment", [None, 0.0, 0.2, 0.5, 0.8])
@pytest.mark.parametrize("family", names.FAMILIES)
def test_followers_that_react_are_those_of_the_twin(family, moment):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        scene = reacting(random_scene(rng, crowding=1.0 + seed), rng, family=family, moment=moment)
        check(*compared(scene, seed=seed))


@pytest.mark.parametrize("parts", [(), ("memory", "a_0", "need"), ("drift",)])
def test_a_command_of_ones_own_plans_as_the_model_that_it_writes_once_more(parts):
    rng = np.random.default_rng(11)
    scene = reacting(random_scene(rng, crowding=2.0), rng, parts=parts)
    L = scene.followers.parameters[0, 5]
    own = replace(scene, followers=replace(scene.followers, family="made_models:again", L_no_change=L))
    same = replace(scene, followers=replace(scene.followers, L_no_change=L))
    by_function, by_model = task_of(own), task_of(same)
    first = evaluate(DURATIONS, *candidates(1), by_function.scene, by_function.terms)
    second = evaluate(DURATIONS, *candidates(1), by_model.scene, by_model.terms)
    for one, two in zip(first, second, strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-9)


@pytest.mark.parametrize("part", ["memory", "relaxation", "need", "drift"])
def test_every_part_of_a_reaction_has_the_same_twin_and_a_meaning(part):
    rng = np.random.default_rng(7)
    scene = random_scene(rng, crowding=2.0)
    found, wanted = compared(reacting(scene, rng, parts=(part, "a_0") if part == "memory" else (part,)))
    check(found, wanted)
    assert not np.allclose(found.hv_H, compared(scene)[0].hv_H)


def test_without_an_old_leader_a_follower_credits_no_more_than_it_desires():
    rng = np.random.default_rng(4)
    scene = replace(random_scene(rng), target_leader=None)
    check(*compared(reacting(scene, rng, parts=("relaxation",))))


BARE = {"memory": 0.0, "relaxation": 0.0, "drift": 0.0, "need": np.inf, "a_0": 0.7}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("neutral", "rtol"), [(BARE, 0.0), ({"need": 1e300, "a_0": 0.7}, 1e-12), ({"drift": 1e-300}, 1e-12)]
)
def test_reactions_that_change_nothing_are_bare_followers(seed, neutral, rtol):
    # To the last bit where every part is absent; present ones run through machine code of their own.
    scene = random_scene(np.random.default_rng(seed), crowding=2.0)
    same = replace(scene, followers=replace(scene.followers, **{k: np.full(3, v) for k, v in neutral.items()}))
    bare, full = task_of(scene), task_of(same)
    first = evaluate(DURATIONS, *candidates(seed), bare.scene, bare.terms)
    second = evaluate(DURATIONS, *candidates(seed), full.scene, full.terms)
    for one, two in zip(first, second, strict=True):
        np.testing.assert_allclose(one, two, rtol=rtol, atol=0.0)


def test_nobody_ahead_and_nobody_behind_on_the_old_lane():
    scene = random_scene(np.random.default_rng(4))
    check(*compared(replace(scene, target_leader=None, origin_leader=None, origin_follower=None)))


@pytest.mark.parametrize("reacts", [False, True])
def test_a_row_does_not_depend_on_its_company(reacts):
    rng = np.random.default_rng(5)
    scene = random_scene(rng)
    task = task_of(reacting(scene, rng, moment=0.5) if reacts else scene)
    delta, change = candidates(1)
    together = evaluate(DURATIONS, delta, change, task.scene, task.terms)
    for row in range(len(DURATIONS)):
        alone = evaluate(
            DURATIONS[row : row + 1], delta[row : row + 1, 5:6], change[row : row + 1, 5:6], task.scene, task.terms
        )
        for one, all_ in zip(alone, together, strict=True):
            assert one[0, 0] == all_[row, 5]


def test_one_simulation_serves_both_ends():
    # Losses to H are not below those to T, and equal where T is all of H.
    scene = random_scene(np.random.default_rng(6), horizon=10.0)
    task = task_of(scene)
    found = evaluate(DURATIONS, *candidates(2), task.scene, task.terms)
    assert (found.av_H >= found.av_T).all()
    assert (found.hv_H >= found.hv_T).all()
    np.testing.assert_allclose(found.av_H[-1], found.av_T[-1], rtol=1e-12)
    np.testing.assert_allclose(found.hv_H[-1], found.hv_T[-1], rtol=1e-12)
