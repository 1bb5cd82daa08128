# SPDX-License-Identifier: Apache-2.0
"""``pm01 export``."""

from __future__ import annotations

import click


@click.command("export", short_help="Write a run's best policy as one ONNX file.")
@click.argument("run")
@click.option("-o", "--output", required=True, metavar="FILE", help="The file to write.")
def command(run: str, output: str) -> None:
    """Write the best policy of the folder RUN as one ONNX file.

    The file holds the normaliser, the network and the robot's limits, and says in its metadata
    which lidar and robot it fits and how it was made. It needs numpy and onnxruntime to run.
    """
    from pm01_nav.config import check_output
    from pm01_nav.training.run_folder import RunFolder
    from pm01_nav.training.trainer import export_best

    folder = RunFolder(run)
    config = folder.load_config()
    check_output(output)
    export_best(folder, config, output)
    click.echo(f"wrote {output}")
