"""A follower model of one's own, as a researcher would write it in a module."""

from highd_lc.drivers.population import PRIOR, behaviours
from highd_lc.drivers.responses import Behaviours, Responses
from highd_lc.vocab import names


def calm(responses: Responses) -> tuple[str, Behaviours]:
    """The population's prior with half of its reaction."""
    drivers = behaviours(PRIOR.constants, responses, PRIOR.moment)
    return names.LCM, drivers._replace(A=0.5 * drivers.A)
