"""Lane-change calibration and validation on HighD recordings."""

from highd_lc.vocab.compile_cache import use_cache_of_this_code

use_cache_of_this_code()
