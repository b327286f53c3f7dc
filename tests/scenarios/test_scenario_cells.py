"""Cells: one row a variant, form, accounting and weight; the same for one thread or two; the sweep is complete."""

import numpy as np
from few_scenarios import few_scenarios

from highd_lc.scenarios.run import combinations, rows_of_sweep, rows_of_variants, variants
from highd_lc.vocab.tables.scenarios import CELLS


def same(one, two):
    for key in one:
        if isinstance(one[key], float) and np.isnan(one[key]):
            assert np.isnan(two[key])
        else:
            assert one[key] == two[key], key


def test_rows_do_not_depend_on_threads_and_fit_the_table():
    alone, together = (rows_of_variants(few_scenarios(), threads=n) for n in (1, 2))
    assert len(alone) == len(together) == 3 * (3 * 6) + 3 * (2 * 6) * 3
    for one, two in zip(alone, together, strict=True):
        same(one, two)
    columns = set(CELLS.column_names)
    assert all(set(row) <= columns | {"loss_av_dt", "loss_hv_dt"} for row in alone)


def test_variants_differ_from_the_default_in_what_they_name():
    named = variants(few_scenarios())
    assert list(named) == ["default", "paper_literal", "bumpers", "weighted"]
    changed = {k for k, v in named["bumpers"].model_dump().items() if v != getattr(named["default"], k)}
    assert changed == {"gap_reading"}


def test_the_sweep_holds_every_combination():
    settings = few_scenarios()
    names_, options = zip(*combinations(settings), strict=True)
    assert len(set(names_)) == 4
    assert {(o.gap_reading, o.v_ref_av) for o in options} == {
        (reading, v) for reading in ("centres", "bumpers") for v in (30.0, 33.54)
    }
    parts = list(rows_of_sweep(settings, threads=2))
    assert [len(part) for part in parts] == [3 * 2 * 6] * 4
    assert [part[0]["variant"] for part in parts] == list(names_)
