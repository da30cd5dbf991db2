"""The page of a replay, served. Oracle: a client that asks for it over HTTP, and the state of its controls."""

import socket
import urllib.request

import numpy as np
import pytest

from phantom_dyn.errors import UsageError
from phantom_dyn.libraries import is_installed

pytestmark = pytest.mark.skipif(not is_installed("viser"), reason="viser is not installed: it is in the extra view")


@pytest.fixture
def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def page(replay, free_port):
    from identification.viewing.browser import served

    with served(replay, host="127.0.0.1", port=free_port) as page:
        yield page


def test_the_page_is_found_where_it_says(page, free_port):
    assert page.url == f"http://127.0.0.1:{free_port}"
    with urllib.request.urlopen(page.url, timeout=20) as answer:
        assert (answer.status, b"<!doctype html>" in answer.read().lower()) == (200, True)


def test_behind_the_context_nobody_listens_any_more(replay, free_port):
    from identification.viewing.browser import served

    with served(replay, host="127.0.0.1", port=free_port):
        pass
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", free_port), timeout=5)


def test_a_port_that_is_taken_is_refused(replay):
    from identification.viewing.browser import served

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(UsageError, match=rf"nothing can listen on --host 127.0.0.1 --port {port} .*another --port"):
            served(replay, host="127.0.0.1", port=port).__enter__()


def test_while_it_is_paused_time_stands(page):
    page.step(1.0)
    assert page.time == 0.0


def test_while_it_is_played_time_goes_on_and_stops_at_the_end(page, replay):
    page.toggle()
    page.step(0.5)
    assert page.time == pytest.approx(0.5)
    page.step(99.0)
    page.step(1.0)
    assert page.time == pytest.approx(replay.t[-1])


def test_from_the_end_it_is_played_from_the_beginning(page):
    page.toggle()
    page.step(99.0)
    page.toggle()
    page.step(0.25)
    assert page.time == pytest.approx(0.25)


def test_where_the_slider_is_put_the_links_are(page, replay):
    page.slider.value = 3.2
    page.step(0.0)
    frame = replay.frame(3.2)
    for body, copy in zip(page.bodies, replay.copies, strict=True):
        for node, pose in zip(body.places, copy.poses[frame, 1:], strict=True):
            np.testing.assert_allclose([*node.position, *node.wxyz], pose, atol=1e-12)


def test_slow_play_loses_no_time_to_the_rounding_of_the_slider(page):
    page.toggle()
    for _ in range(100):
        page.step(0.004)
    assert page.time == pytest.approx(0.4)


def test_the_joint_that_lacks_friction_is_orange_on_the_given_model_alone(page, replay):
    frame = int(np.argmax(replay.copies[1].strength[:, 1] - replay.copies[2].strength[:, 1]))
    page.slider.value = float(replay.t[frame])
    page.step(0.0)
    red_less_blue = [int(body.drums[2].color[0]) - int(body.drums[2].color[2]) for body in page.bodies]
    assert red_less_blue[1] > 150
    assert max(red_less_blue[0], red_less_blue[2]) < 60
