"""Shows a replay in the browser with viser: copies of the robot, controls of time, and curves."""

from __future__ import annotations

import contextlib
import io
import socket
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.reporting.page.robot_scene import share_colour
from identification.viewing.charts import Chart, charts_of
from identification.viewing.replay import Copy, Replay
from identification.viewing.robot_solids import Solids, robot_solids
from identification.viewing.status import curve_names, legend, now_table, summary
from phantom_dyn.errors import UsageError
from phantom_dyn.libraries import optional_library
from phantom_dyn.shapes.meshes import Mesh

if TYPE_CHECKING:
    import viser

FIRST_PORT = 8080
"""Default port; if it is taken, the next free one is used."""
FRAMES_PER_S = 25.0
"""Frames of the page per second."""
_CHARTS_PER_S, _TABLES_PER_S = 12.0, 4.0
_LINK_TINT = 0.4  # strength of a link's colour relative to its joint's, as in the report
_SHADES = 32  # number of shades of a colour; with more shades, nearly every frame would send a new colour
_GHOST = 0.4  # opacity of simulated copies that are shown in the place of the measured copy
_SPEEDS = ("0.1 x", "0.25 x", "0.5 x", "1 x", "2 x", "4 x")
_WINDOWS = {"2 s": 2.0, "5 s": 5.0, "20 s": 20.0, "whole recording": np.inf}
_APART, _TOGETHER = "side by side", "in one place"
_PANEL, _CHART, _FREE, _FIRST_WIDTH, _LEAST_WIDTH = 384, 132, 12, 900, 320
"""Width of the controls, height of a chart, space around the charts, and first and smallest width of charts [px]."""
_FITTED_AFTER_S = 0.7
"""Time [s] between two readings of the window's width; two equal readings mean that the layout is finished."""
_EYES = ((0.4, -1.0, 0.5), (1.0, -0.4, 0.5))
"""Direction from which the first view looks, for copies side by side along x and along y."""
_FOV, _FAR, _BELOW = 0.7, 1.3, 0.5
"""Angle of view [rad]; distance of the camera, relative to the distance at which all copies just fit into the window;
and distance of the view's centre below the middle of the copies, relative to their size. The view is centred below the
copies because charts cover the lower part of the window."""


class _Body:
    """One copy of the robot in the scene.

    Attributes:
        root: The parent of all nodes of the copy.
        label: Name of the copy, shown above the copy.
        places: The frame of each joint.
        drums: The solid that shows each joint; None for the root.
    """

    def __init__(self, server: viser.ViserServer, copy: Copy, replay: Replay, solids: Solids):
        self._copy, self._shades = copy, np.full(replay.robot.nv, -1)
        scene, name = server.scene, copy.name.replace(" ", "_")
        self.root = scene.add_frame(f"/{name}", show_axes=False)
        self.places = [scene.add_frame(f"/{name}/{k}", show_axes=False) for k in range(1, len(solids.links))]
        self._links = _added_solids(server, name, "link", solids.links)
        self._rails = _added_solids(server, name, "rail", solids.rails)
        self.drums = _added_solids(server, name, "joint", solids.drums)
        above = np.array([*solids.middle[:2], solids.top + 0.08 * float(solids.size.max())])
        self.label = scene.add_label(f"/{name}/label", copy.name, position=above, anchor="bottom-center")
        names = list(replay.robot.model.names)
        self._joints = [names.index(joint) for joint in replay.robot.joint_names]

    def place(self, frame: int) -> None:
        """Show the pose and colours of a frame; the copy is hidden if its pose is unknown."""
        pose = self._copy.poses[frame]
        known = bool(np.isfinite(pose).all())
        if self.root.visible != known:
            self.root.visible = known
        if not known:
            return
        for node, place in zip(self.places, pose[1:], strict=True):
            node.position, node.wxyz = place[:3], place[3:]
        shades = np.round(self._copy.strength[frame] * _SHADES).astype(int)
        for row in np.flatnonzero(shades != self._shades):
            joint, share = self._joints[row], shades[row] / _SHADES
            self.drums[joint].color = _rgb(share)
            if self._links[joint] is not None:
                self._links[joint].color = _rgb(share, _LINK_TINT)
        self._shades = shades

    def fade(self, opacity: float | None) -> None:
        """Set the opacity of the copy; None makes it opaque."""
        for solid in (*self.drums, *self._links, *self._rails):
            if solid is not None:
                solid.opacity = opacity


class Page:
    """The page of a replay: its server, and the state of its controls.

    Attributes:
        url: Address of the page.
        slider: The slider for the time.
        bodies: The copies of the robot.
    """

    def __init__(self, server: viser.ViserServer, replay: Replay):
        self._server, self._replay = server, replay
        self.url = f"http://{_shown(server.get_host())}:{server.get_port()}"
        self._playing = False
        self._moment, self._shown_moment = float(replay.t[0]), round(float(replay.t[0]), 2)
        self._drawn: tuple[object, ...] = ()
        self._next_chart = self._next_table = 0.0
        solids = self._build_scene()
        self._build_controls()
        self._build_charts()
        self._look_at(solids)
        self.step(0.0)

    def run(self) -> None:
        """Update the page until the process is interrupted."""
        last = time.monotonic()
        while True:
            time.sleep(1.0 / FRAMES_PER_S)
            now = time.monotonic()
            self.step(now - last)
            last = now

    def toggle(self) -> None:
        """Switch between playing and pause; at the end of the recording, play from the beginning."""
        self._playing = not self._playing
        if self._playing and self.time >= self._replay.t[-1]:
            self._show_moment(float(self._replay.t[0]))
        self._button.label = "Pause" if self._playing else "Play"

    @property
    def time(self) -> float:
        """Time in the recording [s] that is shown. If the user has moved the slider, its time is taken over first."""
        if self.slider.value != self._shown_moment:
            self._show_moment(float(self.slider.value))
        return self._moment

    def _show_moment(self, moment: float) -> None:
        """Set the shown time; the slider only has its value rounded to hundredths of a second."""
        self._moment, self._shown_moment = moment, round(moment, 2)
        if self.slider.value != self._shown_moment:
            self.slider.value = self._shown_moment

    def step(self, seconds: float) -> None:
        """Advance the replay by a time [s] if it is playing, and update the page."""
        if self._playing:
            moment = self.time + seconds * float(self._speed.value.split()[0])
            self._show_moment(float(min(moment, self._replay.t[-1])))
            if moment >= self._replay.t[-1]:
                self.toggle()
        frame, moment = self._replay.frame(self.time), self.time
        wanted = (moment, self._joint.value, self._window.value)
        with self._server.atomic():
            if not self._drawn or self._drawn[0] != moment:
                for body in self.bodies:
                    body.place(frame)
            self._draw_charts(moment, frame, wanted)
            self._fit_panel()
        self._drawn = wanted

    def _draw_charts(self, moment: float, frame: int, wanted: tuple[object, ...]) -> None:
        """Draw charts and table; while the replay is playing, less often than the robots."""
        now = time.monotonic()
        if wanted != self._drawn:
            self._stale_chart = self._stale_table = True
        if self._stale_chart and (not self._playing or now >= self._next_chart):
            self._stale_chart, self._next_chart = False, now + 1.0 / _CHARTS_PER_S
            charts = charts_of(self._replay, self._replay.robot.joint_names.index(self._joint.value))
            for handle, chart in zip(self._charts, charts, strict=True):
                _draw(handle, chart, moment, _WINDOWS[self._window.value])
        if self._stale_table and (not self._playing or now >= self._next_table):
            self._stale_table, self._next_table = False, now + 1.0 / _TABLES_PER_S
            self._table.content = now_table(self._replay, moment, frame)

    def _build_scene(self) -> Solids:
        """Add all copies of the robot and a floor to the scene."""
        replay = self._replay
        solids = robot_solids(replay)
        self._offsets = solids.offsets(len(replay.copies))
        self.bodies = [_Body(self._server, copy, replay, solids) for copy in replay.copies]
        for body, offset in zip(self.bodies, self._offsets, strict=True):
            body.root.position = offset
            for joint in replay.robot.joint_names:
                self._choose_by_click(body, joint)
        middle = solids.middle + self._offsets[-1] / 2
        side = 1.6 * float((solids.size + self._offsets[-1]).max())
        self._server.scene.add_grid(
            "/floor",
            width=side,
            height=side,
            cell_size=side / 32,
            section_size=side / 8,
            position=(middle[0], middle[1], solids.floor),
        )
        return solids

    def _choose_by_click(self, body: _Body, joint: str) -> None:
        """Show the curves of a joint after a click on its solid."""
        drum = body.drums[list(self._replay.robot.model.names).index(joint)]

        @drum.on_click
        def _(_event: object) -> None:
            self._joint.value = joint

    def _build_controls(self) -> None:
        gui, replay = self._server.gui, self._replay
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(0, 114, 178))
        first, last = self._shown_moment, round(float(replay.t[-1]), 2)
        self.slider = gui.add_slider("time [s]", min=first, max=last, step=0.01, initial_value=first)
        self._button = gui.add_button("Play")
        self._button.on_click(lambda _: self.toggle())
        self._speed = gui.add_dropdown("speed", _SPEEDS, initial_value="1 x")
        joints = replay.robot.joint_names
        self._joint = gui.add_dropdown("joint", joints, initial_value=joints[replay.strongest_joint()])
        self._window = gui.add_dropdown("curves", tuple(_WINDOWS), initial_value="5 s")
        arranged = gui.add_dropdown("robots", (_APART, _TOGETHER), initial_value=_APART)
        arranged.on_update(lambda _: self._arrange(arranged.value == _TOGETHER))
        gui.add_markdown(legend(replay))
        self._table = gui.add_markdown(now_table(replay, first, 0))
        with gui.add_folder("About", expand_by_default=True):
            gui.add_markdown(summary(replay))
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_PANEL)

    def _arrange(self, together: bool) -> None:
        """Show all copies side by side, or all in one place with half-transparent simulated copies."""
        for k, body in enumerate(self.bodies):
            body.root.position = self._offsets.mean(axis=0) if together else self._offsets[k]
            body.label.visible = not together
            body.fade(_GHOST if together and k else None)

    def _build_charts(self) -> None:
        gui, replay = self._server.gui, self._replay
        charts = charts_of(replay, replay.strongest_joint())
        panel = gui.add_panel()
        with panel.add_tab("Torque"):
            gui.add_html(curve_names(charts[0]))
            self._charts = [_added(gui, chart) for chart in charts[:2]]
        with panel.add_tab("Position"):
            gui.add_html(curve_names(charts[2]))
            self._charts.append(_added(gui, charts[2]))
        panel.float(x=_FREE, y=-_FREE, width=_FIRST_WIDTH)
        self._panel, self._panel_width, self._seen_width, self._next_fit = panel, _FIRST_WIDTH, _FIRST_WIDTH, 0.0

    def _fit_panel(self) -> None:
        """Fit the width of the charts to the free width of the browser's window, once this width is constant."""
        if time.monotonic() < self._next_fit:
            return
        self._next_fit = time.monotonic() + _FITTED_AFTER_S
        widths = [max(client.camera.image_width, _LEAST_WIDTH) for client in self._server.get_clients().values()]
        width = widths[-1] if widths else self._seen_width
        if width == self._seen_width and width != self._panel_width:
            self._panel_width = width
            self._panel.set_width(width - 2 * _FREE)
        self._seen_width = width

    def _look_at(self, solids: Solids) -> None:
        """Set the initial view, in which the copies are in a row from left to right, above the charts."""
        row = self._offsets[-1]
        radius = max(float(np.linalg.norm(solids.size + row)) / 2, 1e-2)
        eye = np.array(_EYES[int(np.argmax(row))])
        target = solids.middle + row / 2 - np.array([0.0, 0.0, _BELOW * radius])
        camera = self._server.initial_camera
        camera.fov = _FOV
        camera.position = target + _FAR * radius * eye / np.linalg.norm(eye) / np.tan(_FOV / 2)
        camera.look_at = target


@contextlib.contextmanager
def served(replay: Replay, *, host: str, port: int | None) -> Iterator[Page]:
    """Context in which browsers can open the page of a replay.

    Args:
        replay: The replay.
        host: Address on which the server listens.
        port: Port of the server; None for `FIRST_PORT` or the next free port.

    Raises:
        UsageError: If viser is not installed, or no server can listen on this address and port.
    """
    viser = optional_library("viser")
    _require_free(host, port)
    with _silent():
        server = viser.ViserServer(host=host, port=FIRST_PORT if port is None else port, verbose=False)
    try:
        yield Page(server, replay)
    finally:
        with _silent():
            server.stop()


def _silent() -> contextlib.AbstractContextManager[object]:
    """Context that discards the lines that viser prints when it starts and stops."""
    return contextlib.redirect_stdout(io.StringIO())


def _require_free(host: str, port: int | None) -> None:
    """Raise an error if no server can listen on an address; viser would first try a thousand ports."""
    try:
        family, *_, address = socket.getaddrinfo(host, port or 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except (OSError, OverflowError) as error:
        asked = f"--host {host}" + (f" --port {port}" if port is not None else "")
        raise UsageError(
            f"nothing can listen on {asked} ({error}): give another --port, or leave it out for the next that is free"
        ) from error


def _shown(host: str) -> str:
    """Name of the host for a browser on this machine."""
    if host in ("0.0.0.0", "::", ""):  # all addresses of this machine
        return "localhost"
    return f"[{host}]" if ":" in host else host  # a URL has an IPv6 address in brackets


def _rgb(share: float, tint: float = 1.0) -> tuple[int, int, int]:
    red, green, blue = np.round(share_colour(share, tint)).astype(int).tolist()
    return red, green, blue


def _added_solids(server: viser.ViserServer, copy: str, kind: str, meshes: tuple[Mesh, ...]) -> list[Any]:
    """Add a mesh in the frame of each joint of a copy to the scene; returns the nodes, None for an empty mesh."""
    out: list[Any] = [None] * len(meshes)
    for k, mesh in enumerate(meshes):
        if len(mesh.faces):
            name = f"/{copy}/{k}/{kind}" if k else f"/{copy}/{kind}"
            # Both sides of faces are shown, because meshes differ in which side is the outside.
            out[k] = server.scene.add_mesh_simple(
                name, mesh.points, mesh.faces, color=_rgb(0.0), flat_shading=True, side="double"
            )
    return out


def _series(chart: Chart) -> tuple[Any, ...]:
    """Styles of the columns of a chart: time, the lines of each curve, and the vertical line."""
    named = zip(chart.names, chart.colours, strict=True)
    plain = {"points": {"show": False}}
    lines = ({"label": name, "stroke": colour, "width": 1.5, **plain} for name, colour in named)
    drawn = [line for line in lines for _ in range(chart.parts)]
    moment = {"label": "now", "stroke": "#888888", "width": 1.0, "dash": (4.0, 3.0), **plain}
    return ({"label": "t [s]"}, *drawn, moment)


def _added(gui: viser.GuiApi, chart: Chart) -> viser.GuiUplotHandle:
    """Add a chart to the page, showing the first seconds of the recording."""
    middle = float(chart.t[0])
    data = tuple(np.ascontiguousarray(column) for column in chart.about(middle, 5.0).T)
    return gui.add_uplot(
        data,
        _series(chart),
        title=chart.title,
        scales=_scales(chart, middle, 5.0),
        legend={"show": False},
        height=_CHART,
    )


def _scales(chart: Chart, moment: float, seconds: float) -> dict[str, Any]:
    """Ranges of the axes of a chart around a time."""
    half = seconds / 2
    whole = float(chart.t[0]), float(chart.t[-1])
    across = (moment - half, moment + half) if np.isfinite(seconds) else whole
    return {"x": {"time": False, "range": across}, "y": {"range": chart.limits}}


def _draw(handle: viser.GuiUplotHandle, chart: Chart, moment: float, seconds: float) -> None:
    """Update a chart on the page; axes and title are sent only if they have changed."""
    handle.data = tuple(np.ascontiguousarray(column) for column in chart.about(moment, seconds).T)
    scales = _scales(chart, moment, seconds)
    if handle.scales != scales:
        handle.scales = scales
    if handle.title != chart.title:
        handle.title = chart.title
