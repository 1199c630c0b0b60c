"""Small foreign descriptions of hands, generated for the tests of the intake."""

from __future__ import annotations

from pathlib import Path

import trimesh

from gdg.hands.intake import Intake, take_in

LIMIT = '<limit lower="0" upper="1.5" effort="5" velocity="2"/>'
INERTIAL = (
    '<inertial><mass value="0.02"/><inertia ixx="4e-6" iyy="4e-6" izz="4e-6" ixy="0" ixz="0" '
    'iyz="0"/></inertial>'
)


def box(role: str = "collision", size: str = "0.02 0.02 0.05", origin: str = "") -> str:
    """A box shape of a link."""
    return f'<{role}>{origin}<geometry><box size="{size}"/></geometry></{role}>'


def mesh(name: str, role: str = "collision", scale: str = "") -> str:
    """A mesh shape of a link."""
    scale = f' scale="{scale}"' if scale else ""
    return f'<{role}><geometry><mesh filename="{name}"{scale}/></geometry></{role}>'


def link(name: str, *parts: str) -> str:
    """A link with shapes and maybe an inertial."""
    return f'<link name="{name}">{"".join(parts)}</link>'


def joint(
    name: str, parent: str, child: str, inner: str = LIMIT, kind: str = "revolute", z: float = 0.05
) -> str:
    """A joint ``z`` metres above its parent's origin."""
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="0 0 {z}"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="0 1 0"/>{inner}</joint>'
    )


def robot(*parts: str, name: str = "made") -> str:
    """A whole URDF."""
    return f'<robot name="{name}">{"".join(parts)}</robot>'


def finger(inner: str = LIMIT, tip: str = "", kind: str = "revolute") -> str:
    """A palm, a proximal link and a tip; the arguments are the second joint's and the tip's."""
    return robot(
        link("palm", box(), INERTIAL),
        link("proximal", box(), INERTIAL),
        link("tip", tip or box(), INERTIAL),
        joint("j1", "palm", "proximal"),
        joint("j2", "proximal", "tip", inner, kind),
    )


def write(folder: Path, text: str | bytes, name: str = "source/hand.urdf") -> Path:
    """A file with that text, its folders made."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def write_mesh(path: Path, size: float = 0.03, subdivisions: int = 1) -> Path:
    """A ball's mesh of that diameter."""
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.creation.icosphere(subdivisions, radius=size / 2).export(path)
    return path


def take(folder: Path, text: str | bytes, root: str | None = None) -> Intake:
    """The intake of a description, as hand ``acme`` in ``<folder>/new``."""
    name = "source/hand.urdf" if b"<robot" in text_bytes(text) else "source/hand.xml"
    return take_in(write(folder, text, name), folder / "new", "acme", root)


def text_bytes(text: str | bytes) -> bytes:
    """The bytes of a file with that text."""
    return text if isinstance(text, bytes) else text.encode()
