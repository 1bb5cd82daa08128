# SPDX-License-Identifier: Apache-2.0
"""xacro files: their arguments, their packages, and what they must not do."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from pm01_nav.errors import InputError
from pm01_nav.robot_import import expansion, import_urdf
from pm01_nav.robot_import.xacro_worker import check

pytest.importorskip("xacro", reason="needs xacro (extra dev)")

ROOT = Path(__file__).parents[2]
HEAD = '<robot name="bot" xmlns:xacro="http://ros.org/wiki/xacro">'
WHEELS = """<xacro:macro name="wheel" params="name y">
<link name="${name}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>
<collision><geometry><sphere radius="${radius}"/></geometry></collision></link>
<joint name="${name}_joint" type="continuous"><parent link="base_link"/><child link="${name}"/>
<origin xyz="0 ${y} 0"/><axis xyz="0 1 0"/></joint></xacro:macro>"""
BODY = """<xacro:arg name="track" default="0.3"/><xacro:property name="radius" value="${5 / 100}"/>
<link name="base_link"><collision><geometry><box size="0.3 0.2 0.1"/></geometry></collision></link>
<xacro:wheel name="left" y="${float('$(arg track)') / 2}"/>
<xacro:wheel name="right" y="${-float('$(arg track)') / 2}"/>"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A package whose robot includes another package's file."""
    for name in ("bot_description", "wheels_description"):
        (tmp_path / "src" / name / "urdf").mkdir(parents=True)
        package = f"<package><name>{name}</name></package>"
        (tmp_path / "src" / name / "package.xml").write_text(package)
    wheels = tmp_path / "src" / "wheels_description" / "urdf" / "wheels.xacro"
    wheels.write_text(f"{HEAD}{WHEELS}</robot>")
    include = '<xacro:include filename="$(find wheels_description)/urdf/wheels.xacro"/>'
    robot = tmp_path / "src" / "bot_description" / "urdf" / "bot.urdf.xacro"
    robot.write_text(f"{HEAD}{include}{BODY}</robot>")
    return tmp_path


def test_a_xacro_file_is_expanded(folder: Path, tmp_path: Path) -> None:
    path = folder / "src" / "bot_description" / "urdf" / "bot.urdf.xacro"
    robot = import_urdf(path)
    assert (robot.spec.wheels.radius, robot.spec.wheels.separation) == (0.05, 0.3)
    assert import_urdf(path, arguments={"track": "0.4"}).spec.wheels.separation == 0.4
    alone = tmp_path / "alone.xacro"
    alone.write_text(path.read_text())
    with pytest.raises(
        InputError, match=r"package 'wheels_description': not found; give --packages DIR"
    ):
        import_urdf(alone)
    assert import_urdf(alone, packages=[folder / "src"]).spec.wheels == robot.spec.wheels


def test_our_own_description_needs_no_expansion_first() -> None:
    source = ROOT / "src" / "pm01_description" / "urdf" / "pm01.urdf.xacro"
    robot = import_urdf(source, arguments={"gazebo": "harmonic"})
    assert not robot.warnings
    assert (robot.spec.wheels.radius, robot.spec.wheels.separation) == (0.05, 0.28)


@pytest.mark.parametrize(
    ("inside", "message"),
    [
        ('<link name="$(arg side)"/>', r"Undefined substitution argument side: give side:=VALUE"),
        ('<link name="${a}base_link"/>', "name 'a' is not defined"),
        ('<xacro:include filename="none.xacro"/>', "No such file or directory"),
        ('<link name="${().__class__}"/>', "'__class__' is not allowed in an expression"),
        ("<link name=\"${'0'.format(1)}\"/>", "'format' is not allowed in an expression"),
        ('<link name="${python.vars(1)}"/>', "'vars' is not allowed"),
        (
            '<link name="${[g.gi_frame for g in [(1 for x in [1])]]}"/>',
            "'gi_frame' is not allowed in an expression",
        ),
        ('<link name="$(eval 1 .__class__)"/>', "'__class__' is not allowed"),
    ],
)
def test_what_cannot_be_expanded(tmp_path: Path, inside: str, message: str) -> None:
    path = tmp_path / "bot.xacro"
    path.write_text(f"{HEAD}{inside}</robot>")
    with pytest.raises(InputError, match=message) as error:
        import_urdf(path)
    assert str(error.value).startswith(f"{path}: xacro: ")
    assert "\n" not in str(error.value)


def test_expressions_of_public_files_are_allowed() -> None:
    for text in (
        "1.5 * pi + radians(90)",
        "[float(x) for x in '1 2'.split()]",
        "config['wheels'].radius if side == 'left' else -1",
        "xacro.load_yaml('a.yaml')['x']",
        "(lambda x: x * x)(2)",
    ):
        check(text)


def test_endless_files_are_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(expansion, "TIMEOUT_S", 1.0)
    path = tmp_path / "bot.xacro"
    path.write_text(f'{HEAD}<link name="${{9 ** 9 ** 9}}"/></robot>')
    with pytest.raises(InputError, match=r"bot\.xacro: xacro: takes more than 1 s"):
        import_urdf(path)


def test_without_xacro(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "bot.xacro"
    path.write_text(f"{HEAD}{WHEELS}{BODY}</robot>")
    (tmp_path / "hidden").mkdir()
    (tmp_path / "hidden" / "xacro.py").write_text("raise ModuleNotFoundError(name='xacro')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "hidden"))
    monkeypatch.setattr(sys, "path", [str(tmp_path / "hidden"), *sys.path])
    with pytest.raises(InputError, match=r"holds xacro macros, and xacro is missing: pip install"):
        import_urdf(path)
