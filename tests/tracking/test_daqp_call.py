"""DAQP through the compiled door against DAQP's own Python interface."""

import json
import subprocess
import sys
from pathlib import Path

import daqp
import numpy as np
import pytest

from highd_lc.tracking.daqp_call import INFINITY, PROBLEM, RESULT, check_daqp, daqp_solve


def problem(rng, n, m):
    root = rng.normal(size=(n, n))
    return root @ root.T + np.eye(n), rng.normal(size=n), rng.normal(size=(m, n)), rng.uniform(0.05, 0.5, m)


def compiled(H, f, A, upper):
    x, lam = np.zeros(len(f)), np.zeros(len(upper))
    lower, sense = np.full(len(upper), -INFINITY), np.zeros(len(upper), np.intc)
    flag = daqp_solve(H, f, A, upper, lower, sense, x, lam, np.zeros(1, PROBLEM), np.zeros(1, RESULT))
    return flag, x, lam


def test_the_door_opens():
    check_daqp()


@pytest.mark.parametrize("seed", range(10))
def test_equal_to_the_python_interface_to_the_last_bit(seed):
    rng = np.random.default_rng(seed)
    H, f, A, upper = problem(rng, n=int(rng.integers(2, 12)), m=int(rng.integers(1, 40)))
    flag, x, lam = compiled(H, f, A, upper)
    theirs, _, exitflag, info = daqp.solve(
        H, f, A, upper, np.full(len(upper), -INFINITY), np.zeros(len(upper), np.intc)
    )
    assert flag == exitflag == 1
    np.testing.assert_array_equal(x, theirs)
    np.testing.assert_array_equal(lam, info["lam"])


def test_infeasible_and_not_convex_come_back_as_flags():
    A = np.array([[1.0, 0.0], [-1.0, 0.0]])
    assert compiled(np.eye(2), np.ones(2), A, np.array([-1.0, -1.0]))[0] == -1
    assert compiled(np.diag([1.0, -1.0]), np.ones(2), A, np.ones(2))[0] < 0


_WITHOUT_THE_SYMBOL = """
import sys
import numpy as np
from highd_lc.tracking import daqp_call

daqp_call.ask_python()
calls = []
sys.path.insert(0, {tests!r})
from test_daqp_call import compiled, problem

solve = daqp_call.daqp.solve
daqp_call.daqp.solve = lambda *given: calls.append(1) or solve(*given)
daqp_call.check_daqp()
found = [compiled(*problem(np.random.default_rng(seed), 5, 12)) for seed in range(3)]
print(len(calls), [[flag, x.tolist(), lam.tolist()] for flag, x, lam in found])
"""


def test_where_the_symbol_is_kept_private_python_gives_the_same_bits():
    program = _WITHOUT_THE_SYMBOL.format(tests=str(Path(__file__).parent))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    calls, _, values = done.stdout.strip().partition(" ")
    ours = [compiled(*problem(np.random.default_rng(seed), 5, 12)) for seed in range(3)]
    assert json.loads(values) == [[flag, x.tolist(), lam.tolist()] for flag, x, lam in ours]
    assert calls == "4"
