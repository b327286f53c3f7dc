import gc

import pytest

from highd_lc.stages import report


def test_cycles_wait_until_the_end_and_are_found_then():
    with report.put_off():
        assert not gc.isenabled()
        for _ in range(3):
            cycle = []
            cycle.append(cycle)
        del cycle
    assert gc.isenabled()
    assert gc.collect(0) == 0


def test_an_error_inside_turns_it_on_again():
    with pytest.raises(KeyError), report.put_off():
        raise KeyError
    assert gc.isenabled()


def test_who_had_turned_it_off_keeps_it_off():
    gc.disable()
    try:
        with report.put_off():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()
