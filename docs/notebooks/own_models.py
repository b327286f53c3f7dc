# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # A follower model and a planner of your own
#
# Both are plain functions. They are judged as the package's own are: the model by how it predicts recorded
# followers, the planner by losses, limits, contacts and tracking on the same events.

# %%
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

import highd_lc as lc

folder = Path(tempfile.mkdtemp())

# %% [markdown]
# ## A follower model
# It gets speeds [m/s], the spacing front to front [m] and its parameters, the last of which is the length of the
# leader. A run finds it by module and name.

# %%
(folder / "my_drivers.py").write_text('''
def keeper(v, v_leader, spacing, parameters):
    """Keeps a time gap, and closes in by the difference of speeds."""
    v_0, T, length = parameters
    gap = spacing - length
    return max(min(0.2 * (v_0 - v), 0.03 * (gap - 2.0 - v * T) + 0.3 * (v_leader - v)), -3.0)


keeper.parameters = {"v_0": 31.0, "T": lambda responses: 1.1 + 0.4 * responses.truck}
''')
(folder / "mine.toml").write_text("""
name = "mine"
stages = ["ingest", "extract", "calibrate"]
[calibrate]
optimiser = "screen"
screened = 128
models = ["constant_speed", "decaying_acceleration", "drift", "population", "my_drivers:keeper@crossing"]
""")

# %% [markdown]
# The command line does it: recordings, lane changes, fits, and then every model behind the recorded lane changers.

# %%
import os
import subprocess
import sys


def highd_lc(*arguments):
    """The command line, with modules of this folder."""
    program = [sys.executable, "-m", "highd_lc.cli", *map(str, arguments)]
    paths = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        program, cwd=folder, env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True
    )
    assert done.returncode in (0, 4), done.stderr
    return done.stdout


highd_lc("synthesize", "data", "--recordings", 2, "--seconds", 30, "--pipeline", "demo", "--seed", 4)
print(highd_lc("calibrate", "--data", "data", "--pipeline", "mine.toml", "--workers", 1)[-2000:])

# %%
summary = pd.read_parquet(folder / "work" / "prediction_summary.parquet")
mine = summary[(summary["stratum"] == "all") & (summary["horizon_s"] == 5.0)].set_index("model")
mine[["n_events", "bias", "mae", "skill_constant"]]

# %%
assert "my_drivers:keeper@crossing" in mine.index

# %% [markdown]
# ## A planner
# It sees the scene and returns the motion of the rear axle in steps of 0.1 s to the end of the lane change, or
# says why there is none.


# %%
def careful(scene):
    """Six seconds, unless somebody is close behind."""
    if len(scene.followers.x) and scene.followers.x[0] > -20.0:
        return "somebody is too close behind"
    u = np.arange(61) / 60.0
    return lc.PlannedMotion(x=scene.v0 * 6.0 * u, y=scene.lateral_shift * (6 * u**5 - 15 * u**4 + 10 * u**3))


scene = lc.Scene.of(lc.Vehicle(v=28.0), followers=[lc.Vehicle(x=-40.0, v=30.0, driver=lc.SIMULATION)])
table = lc.compare(scene, [lc.BENCHMARK, lc.LOCAL_OPTIMUM, careful])
table

# %%
assert list(table.index) == ["benchmark", "local_optimum", "careful"]
lc.plan(lc.Scene.of(lc.Vehicle(v=28.0), followers=[lc.Vehicle(x=-15.0, v=30.0)]), careful).status

# %% [markdown]
# On recordings: `highd-lc validate --planner module:careful`; a leaderboard sets it beside the package's policies.
