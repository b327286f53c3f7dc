"""Why an AV in the closed loop touches somebody (equations.md 7.5)."""

from collections.abc import Callable
from dataclasses import replace

from highd_lc.driving.loop import Case, ClosedLoop, drive_closed_loop
from highd_lc.driving.tracker import Tracker
from highd_lc.planning.planner import overlap_at_start, unchanged_contacts
from highd_lc.vocab import names
from highd_lc.vocab.sections import RECORDED_LEADERS


def causes(case: Case, loop: ClosedLoop, known: ClosedLoop, tracker: Callable[[], Tracker]) -> tuple[str, ...]:
    """Of each contact of a drive its cause, of ``names.LOOP_CAUSES``.

    known: the drive of who knows all that comes; tracker: makes one for a further drive. That tells leaders from
    followers that are predicted wrongly, where the world's followers are others than those believed in.
    """
    if not loop.met:
        return ()
    near = overlap_at_start(case.problem)
    alone = unchanged_contacts(replace(case.problem, packed=case.world))
    unforeseen = _unforeseen(case, loop, known, tracker)
    found = []
    for name in loop.met:
        if not set(near).isdisjoint(name.removeprefix("clearance_").split("_through_")):
            found.append(names.BY_START)
        elif name in unforeseen:
            found.append(unforeseen[name])
        else:
            found.append(names.BY_FOLLOWER_MODEL if name in alone else names.BY_FORESIGHT)
    return tuple(found)


def _unforeseen(case: Case, loop: ClosedLoop, known: ClosedLoop, tracker: Callable[[], Tracker]) -> dict[str, str]:
    """The contacts that who knows all that comes does not have, and whom the AV predicted wrongly."""
    missing = [name for name in loop.met if name not in known.met]
    if not missing or case.world is case.problem.packed:
        return dict.fromkeys(missing, names.BY_LEADERS)
    settings = case.settings.model_copy(update={"leaders": RECORDED_LEADERS})
    foreseeing = drive_closed_loop(replace(case, settings=settings), tracker())
    return {name: names.BY_FOLLOWERS if name in foreseeing.met else names.BY_LEADERS for name in missing}
