"""Off-screen pictures of scenes, by pyvista; needs no display."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyvista
from PIL import Image

from gdg.report.meshes import PictureMesh
from gdg.report.palette import HAND, OBJECT_PLAIN, TABLE, contact_colors, unit_rgb
from gdg.report.scene import Scene
from gdg.report.views import camera_axes

#: Pictures are drawn this much larger and scaled down, against jagged edges.
SUPERSAMPLING = 2
#: Drawn beyond each edge and cut off: there the occlusion is wrong, pixels before scaling down.
BLEED_PX = 8
#: Narrow, so that sizes near and far can be compared.
FIELD_OF_VIEW_DEG = 18.0
#: Share of the picture's sides that stays free around what is shown.
BORDER = 0.05
#: What is below a table shows through it.
TABLE_OPACITY = 0.45
#: How far from a surface others darken it, metres.
OCCLUSION_RADIUS_M = 0.012
#: Lights by direction in the camera's frame (right, up, towards the viewer) and strength.
LIGHTS = (((-0.5, 0.8, 1.0), 0.60), ((0.9, 0.15, 0.7), 0.46), ((0.0, -0.6, 0.5), 0.16))

Color = tuple[float, float, float]


@dataclass(frozen=True)
class Drawn:
    """A mesh in a picture."""

    actor: pyvista.Actor
    surface: pyvista.PolyData

    def place(self, T_world_mesh: np.ndarray) -> None:
        """Moves the mesh; (4, 4), metres."""
        self.actor.user_matrix = T_world_mesh.astype(np.float64)

    def show(self, visible: bool) -> None:
        """Shows or hides the mesh."""
        self.actor.visibility = visible

    def paint(self, rgb: np.ndarray) -> None:
        """Colours the vertices; (vertex, 3) uint8 sRGB."""
        self.surface.point_data["rgb"] = rgb


class Renderer:
    """One off-screen window, used for all pictures of one size.

    To be closed at the end (``contextlib.closing``).

    Args:
        width: of the pictures, pixels.
        height: of the pictures, pixels.
        background: sRGB in [0, 1].
    """

    def __init__(self, width: int, height: int, background: Color = (1.0, 1.0, 1.0)):
        # without a display VTK falls back to EGL or software, and warns of it each time
        pyvista.vtk_verbosity("off")
        self._size = (width, height)
        size = [SUPERSAMPLING * length + 2 * BLEED_PX for length in self._size]
        self._plotter = pyvista.Plotter(off_screen=True, window_size=size, lighting="none")
        self._plotter.set_background(background)  # pyright: ignore[reportArgumentType, reportCallIssue]
        for direction, strength in LIGHTS:
            light = pyvista.Light(light_type="camera light", intensity=strength)
            # the camera light's frame: the camera at (0, 0, 1), looking at the origin
            light.position = direction
            self._plotter.add_light(light)
        self._plotter.enable_ssao(  # pyright: ignore[reportCallIssue]
            radius=OCCLUSION_RADIUS_M, bias=0.0006, kernel_size=16
        )

    def close(self) -> None:
        """Frees the window."""
        self._plotter.close()

    def add(
        self, mesh: PictureMesh, color: Color, shine: float = 0.15, opacity: float = 1.0
    ) -> Drawn:
        """Adds a mesh in one colour; its vertices may be coloured later."""
        surface = pyvista.PolyData.from_regular_faces(mesh.vertices, mesh.faces)
        surface.point_data.active_normals = mesh.normals
        surface.point_data["rgb"] = _repeated(color, len(mesh.vertices))
        actor = self._plotter.add_mesh(
            surface,
            scalars="rgb",
            rgb=True,
            ambient=0.38,
            diffuse=0.85,
            specular=shine,
            specular_power=30,
            opacity=opacity,
            reset_camera=False,
        )
        # not smooth_shading=True, which would copy the mesh and make its own normals
        actor.prop.interpolation = "Phong"
        return Drawn(actor, surface)

    def picture(self, eye: np.ndarray, shown: np.ndarray) -> Image.Image:
        """The scene seen from a direction, framed so that all of ``shown`` is in the picture.

        Args:
            eye: unit vector towards the viewer, z is up.
            shown: (n, 3) points, metres.
        """
        self._aim(eye, shown)
        self._plotter.render()
        pixels = np.asarray(self._plotter.screenshot(return_img=True))
        pixels = pixels[BLEED_PX:-BLEED_PX, BLEED_PX:-BLEED_PX]
        return Image.fromarray(pixels).resize(self._size, Image.Resampling.LANCZOS)

    def _aim(self, eye: np.ndarray, shown: np.ndarray) -> None:
        right, up = camera_axes(eye)
        across, along = shown @ right, shown @ up
        center = (across.max() + across.min()) / 2 * right + (along.max() + along.min()) / 2 * up
        depth = shown @ eye
        half_height = max(np.ptp(along), np.ptp(across) * self._size[1] / self._size[0]) / 2
        slope = np.tan(np.radians(FIELD_OF_VIEW_DEG / 2))
        distance = half_height / ((1 - 2 * BORDER) * slope)
        focus = center + depth.mean() * eye
        camera = self._plotter.camera
        camera.focal_point = focus
        camera.position = focus + (distance + np.ptp(depth) / 4) * eye
        camera.up = up
        camera.view_angle = FIELD_OF_VIEW_DEG
        self._plotter.reset_camera_clipping_range()


class SceneRenderer(Renderer):
    """Draws the grasps of one scene, one at a time."""

    def __init__(self, scene: Scene, width: int, height: int, background: Color):
        super().__init__(width, height, background)
        self._scene = scene
        self._object = self.add(scene.object_mesh, unit_rgb(OBJECT_PLAIN), shine=0.05)
        self._links = {
            link: self.add(mesh, unit_rgb(HAND), shine=0.25)
            for link, mesh in scene.link_meshes.items()
        }
        if scene.table is not None:
            self.add(scene.table, unit_rgb(TABLE), shine=0.0, opacity=TABLE_OPACITY)

    def grasp(self, index: int, eyes: Sequence[np.ndarray]) -> list[Image.Image]:
        """Pictures of one grasp from the given directions."""
        for link, drawn in self._links.items():
            drawn.place(self._scene.Ts_object_link[index, link])
        if self._scene.values is not None:
            self._object.paint(contact_colors(self._scene.values[index]))
        return [self.picture(eye, self._scene.frames[index]) for eye in eyes]


def _repeated(color: Color, count: int) -> np.ndarray:
    return np.tile(np.rint(np.array(color) * 255).astype(np.uint8), (count, 1))
