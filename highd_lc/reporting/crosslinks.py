"""The links between a report and the scenarios beside it, either of which may be made first, or alone.

Every page is written with room for the link, which a reader does not see. Whoever is made second turns the room
into the link, on its own pages and on those that it finds: the result does not depend on the order.
"""

from dataclasses import dataclass
from typing import Final

from markupsafe import Markup


@dataclass(frozen=True)
class Crosslink:
    """A link in the navigation to pages that another command makes. href: relative to the page."""

    href: str
    title: str

    @property
    def room(self) -> Markup:
        """What stands on a page as long as there is nothing to lead to."""
        return Markup("<!-- room for {} -->").format(self.href)

    @property
    def link(self) -> Markup:
        """What stands there afterwards."""
        return Markup('<a href="{}">{}</a>').format(self.href, self.title)

    def opened(self, page: bytes) -> bytes:
        """A page with the link in its room; as it is where it has none."""
        return page.replace(self.room.encode(), self.link.encode())


TO_SCENARIOS: Final = Crosslink("scenarios/index.html", "Scenarios")
"""From the overview pages of a report."""
TO_REPORT: Final = Crosslink("../index.html", "Report of the recordings")
"""From the pages of the scenarios."""
