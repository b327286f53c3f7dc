"""Commands about single lane changes: list, show and export them."""

from pathlib import Path
from typing import Annotated

import typer

from highd_lc.cli_console import PLAIN, console, errors, print_json
from highd_lc.vocab.errors import UsageError

Work = Annotated[Path, typer.Option(help="folder of the artefacts")]
Json = Annotated[bool, typer.Option("--json", help="print the results as JSON and nothing else")]
DEFAULT_WORK = Path("work")


def add_commands(app: typer.Typer) -> None:
    """Add the commands to the command line."""
    _add_list(app)
    _add_show(app)
    _add_export(app)


def _add_list(app: typer.Typer) -> None:
    @app.command("list")
    def list_(
        work: Work = DEFAULT_WORK,
        direction: Annotated[str | None, typer.Option(metavar="left|right", help="to that side only")] = None,
        class_: Annotated[str | None, typer.Option("--class", metavar="Car|Truck", help="egos of it")] = None,
        recording: Annotated[list[int] | None, typer.Option(help="of that recording only (repeatable)")] = None,
        reason: Annotated[
            str | None, typer.Option(help="not the usable ones: those not used for that reason; any = all such")
        ] = None,
        json_: Json = False,
        csv: Annotated[bool, typer.Option("--csv", help="print the list as CSV and nothing else")] = False,
    ) -> None:
        """List the lane changes of a work folder, usable ones unless --reason is given."""
        from highd_lc.io.event_description import list_events, list_text, records

        if json_ and csv:
            raise UsageError("--json and --csv: one of them, not both")
        found = list_events(
            work, direction=direction, vehicle_class=class_, recordings=tuple(recording or ()), reason=reason
        )
        if json_:
            print_json(records(found))
            return
        console.print(found.to_csv(index=False).rstrip("\n") if csv else list_text(found), **PLAIN)


def _add_show(app: typer.Typer) -> None:
    @app.command()
    def show(
        event_id: Annotated[str, typer.Argument(help="RR-VVVV-FFFFF: recording, ego, crossing frame")],
        work: Work = DEFAULT_WORK,
        json_: Json = False,
    ) -> None:
        """Print one lane change: its roles, frames and reasons."""
        from highd_lc.io.event_description import describe_event, event_facts

        if json_:
            print_json(event_facts(work, event_id))
            return
        console.print(describe_event(work, event_id), **PLAIN)


def _add_export(app: typer.Typer) -> None:
    @app.command("export")
    def export_(
        event_ids: Annotated[list[str], typer.Argument(help="RR-VVVV-FFFFF of one event or of several")],
        to: Annotated[str, typer.Option(metavar="csv|omega-prime|commonroad|openscenario", help="format")] = "csv",
        policy: Annotated[
            str, typer.Option(help="who plans the ego; recorded = everybody as recorded")
        ] = "recorded",
        work: Work = DEFAULT_WORK,
        out: Annotated[Path, typer.Option(help="folder to write to")] = Path("exports"),
        raw: Annotated[
            bool, typer.Option("--raw", help="export data in HighD's format: not to be shared")
        ] = False,
    ) -> None:
        """Write lane changes, recorded or planned, for other tools."""
        from highd_lc.io.exports import export

        written = export(work, event_ids, to, policy=policy, out=out, raw=raw)
        if raw:
            errors.print("warning: files with recorded motion of HighD may not be shared (its licence)")
        console.print(*map(str, written), sep="\n", **PLAIN)
