# SPDX-License-Identifier: Apache-2.0
"""``pm01 publish``."""

from __future__ import annotations

import click


@click.command("publish", short_help="Lay out a policy as a Hugging Face model repository.")
@click.argument("policy")
@click.option("--dry-run", is_flag=True, help="Write the folder; nothing is sent.")
@click.option("-o", "--output", required=True, metavar="DIR", help="The folder to write.")
def command(policy: str, dry_run: bool, output: str) -> None:
    """Write POLICY (a file, a run's folder or zoo:NAME) as a model repository: file, card, results.

    This program sends nothing anywhere. To upload the folder, look at it and then use Hugging
    Face's own client.

    \b
      pm01 publish zoo:pm01-mixed --dry-run -o pm01-mixed
      hf upload USER/pm01-mixed pm01-mixed
    """
    from pathlib import Path

    from pm01_nav.errors import InputError
    from pm01_nav.publish import write_repository

    if not dry_run:
        raise InputError(
            "publish: nothing is sent from here; give --dry-run, look at the folder, and upload it "
            "with `hf upload`"
        )
    for path in write_repository(policy, Path(output)):
        click.echo(f"wrote {path}")
