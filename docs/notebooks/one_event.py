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
# # One event, from the recording to the plan
#
# A recording is read, a lane change is chosen, the driver behind it is fitted, and the lane change is planned
# twice: for oneself, and for those behind as well. Open this file as a notebook with jupytext, or read it here.
# The recording is synthetic; `lc.read_recording("data/highd", 1)` reads one of HighD.

# %%
import highd_lc as lc

recording = lc.synthesize(recordings=1, seconds=60, seed=6)[0]
recording.quality.T

# %% [markdown]
# ## Which lane changes can be used
# Every change of lane id is usable or has exactly one reason why not.

# %%
lc.funnel(recording).groupby(["usable", "reason"]).size()

# %%
event = lc.lane_changes(recording)[0]
{name: event.about[name] for name in ("event_id", "ego_class", "direction", "duration_s")}

# %% [markdown]
# ## Who drives behind
# The LCM is fitted to the follower's car-following before the lane change. A parameter on a bound of the search is
# one that the motion does not tell.

# %%
fit = lc.fit_driver(event.followers[0])
print(fit.status, fit.reason)
print(fit.driver)
print(f"rmse of spacing {fit.errors.rmse_spacing:.2f} m; on a bound: {fit.bounds_hit}")

# %% [markdown]
# ## What each policy would do
# `equal` charges AV and followers over the same 15 s.

# %%
scene = event.scene(drivers=lc.fit_drivers(event))
policies = [lc.NO_LANE_CHANGE, lc.HUMAN, lc.BENCHMARK, lc.LOCAL_OPTIMUM]
table = lc.compare(scene, policies, accounting="equal")
table

# %%
plan = lc.plan(scene, lc.LOCAL_OPTIMUM, accounting="equal")
assert plan.status == "solved"
figure = plan.plot()
print(f"T = {plan.T:.1f} s, followers' loss {plan.loss.followers:.2f}")

# %% [markdown]
# ## Can it be driven?
# A model predictive controller steers a bicycle along the plan.

# %%
tracked = lc.track(plan)
print(f"lateral error {tracked.rmse_lateral_m:.3f} m (root mean square), violations: {tracked.violations}")
assert tracked.rmse_lateral_m < 0.2

# %% [markdown]
# ## And now?
# The followers' losses above are simulated. Whether the difference between two of them means anything depends on
# how well such a simulation predicts the recorded follower, which one event cannot tell: see
# *How followers are judged*.
