"""What ``import highd_lc as lc`` offers: each name is imported from where it stands when it is first asked for."""

from highd_lc.api.fits import DriverFit as DriverFit
from highd_lc.api.fits import fit_driver as fit_driver
from highd_lc.api.fits import fit_drivers as fit_drivers
from highd_lc.api.fits import simulate_platoon as simulate_platoon
from highd_lc.api.plans import Loss as Loss
from highd_lc.api.plans import Plan as Plan
from highd_lc.api.plans import Tracked as Tracked
from highd_lc.api.plans import compare as compare
from highd_lc.api.plans import plan as plan
from highd_lc.api.plans import track as track
from highd_lc.api.recordings import Event as Event
from highd_lc.api.recordings import Follower as Follower
from highd_lc.api.recordings import Recording as Recording
from highd_lc.api.recordings import funnel as funnel
from highd_lc.api.recordings import lane_changes as lane_changes
from highd_lc.api.recordings import read_recording as read_recording
from highd_lc.api.recordings import synthesize as synthesize
from highd_lc.api.scenes import Scene as Scene
from highd_lc.api.scenes import Vehicle as Vehicle
from highd_lc.planning.replay import PlannedMotion as PlannedMotion
from highd_lc.vocab.driver import SIMULATION as SIMULATION
from highd_lc.vocab.driver import TABLE3_MEANS as TABLE3_MEANS
from highd_lc.vocab.driver import LcmParameters as LcmParameters
from highd_lc.vocab.errors import HighdLcError as HighdLcError
from highd_lc.vocab.errors import InputError as InputError
from highd_lc.vocab.errors import SettingsError as SettingsError
from highd_lc.vocab.errors import UsageError as UsageError
from highd_lc.vocab.names import ACCOUNTINGS as ACCOUNTINGS
from highd_lc.vocab.names import BENCHMARK as BENCHMARK
from highd_lc.vocab.names import BENCHMARK_FREE as BENCHMARK_FREE
from highd_lc.vocab.names import BENCHMARK_FREE_START as BENCHMARK_FREE_START
from highd_lc.vocab.names import BENCHMARK_START as BENCHMARK_START
from highd_lc.vocab.names import CONSTANT as CONSTANT
from highd_lc.vocab.names import HUMAN as HUMAN
from highd_lc.vocab.names import LOCAL_OPTIMUM as LOCAL_OPTIMUM
from highd_lc.vocab.names import LOCAL_OPTIMUM_FREE as LOCAL_OPTIMUM_FREE
from highd_lc.vocab.names import LOCAL_OPTIMUM_FREE_START as LOCAL_OPTIMUM_FREE_START
from highd_lc.vocab.names import LOCAL_OPTIMUM_START as LOCAL_OPTIMUM_START
from highd_lc.vocab.names import NO_LANE_CHANGE as NO_LANE_CHANGE
from highd_lc.vocab.names import POLICIES as POLICIES
from highd_lc.vocab.sections import RecorderSettings as RecorderSettings

__version__: str
