# SPDX-License-Identifier: Apache-2.0
"""``pm01 report``."""

from __future__ import annotations

import click


@click.command("report", short_help="Show a benchmark's results as one HTML file.")
@click.argument("folders", nargs=-1, required=True, metavar="FOLDER...")
@click.option("-o", "--out", metavar="FILE.html", help="The report.  [default: FOLDER/report.html]")
def command(folders: tuple[str, ...], out: str | None) -> None:
    """Show what `pm01 benchmark` measured: tables, curves and replays in one HTML file.

    \b
      pm01 report results/x
      pm01 report results/x results/y -o report.html

    The file needs no network and nothing beside it. Several folders are merged; what was not
    measured on the same worlds, rules and robot is refused. The tables (results.json, results.csv,
    episodes.csv) are written anew: into the folder, or beside the report if there are several.
    """
    from pm01_nav.errors import InputError

    try:
        from pm01_nav.report.build import write_report
    except ImportError as error:
        raise InputError("a report needs: pip install 'pm01-nav[sim,viz]'") from error
    path = write_report(folders, out)
    click.echo(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB)")
