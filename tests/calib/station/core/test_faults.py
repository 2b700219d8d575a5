"""Faults of the field as an enum, injected into one healthy run; each says in its own words what must come of it."""

from collections.abc import Iterator
from dataclasses import replace
from enum import Enum
from itertools import chain

import msgspec
import numpy as np
import pytest

from calib.network import from_toml, to_toml
from calib.station.archive import recording
from calib.station.archive.recording import Recorder
from calib.station.core.jobs import Solved, SolveResult
from calib.station.core.station import Station
from edge.messages import Tracks, encode
from tests.calib.station.conftest import Fed, station_for
from tools.doubles.box_messages import SITE, Sent, messages, state_messages, tracks_messages
from tools.doubles.faults import CLOCK_STEPPED, KNOCKED, faulty_frames
from tools.doubles.flight import T0_UNIX_NS, Scene, Spec, make

SPEC = Spec(cameras=4, uavs=2, rate_hz=15.0, duration_s=20.0)
EVENT_S = 8.0
NS = 10**9


class Fault(Enum):
    """What happens to cam2 eight seconds into a healthy flight."""

    KNOCKED = "suspect: cam2 named within 5 s, left out of every target, targets go on"
    CLOCK_STEPPED = "suspect: cam2 named within 5 s, targets go on"
    SILENT = "calibrated: cam2 shown as silent, targets go on from the others"
    FLOODED = "calibrated: cam2's hundred detections a frame are not used, targets go on"
    FROZEN = "suspect: cam2's picture named as frozen"
    ALL_SILENT = "no target is sent three seconds later; its end was said"
    ONE_LEFT = "no new target from one camera; the old ones end"
    ALL_CLOCKS_BACK = "nothing is sent from times that contradict the network, then it is tried anew"

    def apply(self, scene: Scene) -> Iterator[Sent]:
        """The run with this fault in it."""
        count = 0
        for sent in self._stream(scene):
            late = sent.arrival_ns > T0_UNIX_NS + EVENT_S * NS
            ours, tracks = "/cam2/" in sent.key, sent.key.endswith("tracks")
            if not late or not tracks:
                yield sent
            elif self is Fault.FLOODED and ours:
                yield sent._replace(payload=_flooded(sent.payload, scene))
            elif self is Fault.FROZEN and ours:
                count += 1
                yield sent._replace(payload=_frozen(sent.payload, scene))
            elif self is Fault.ALL_CLOCKS_BACK:
                yield sent._replace(payload=_moved(sent.payload, -3600 * NS))
            elif not (
                (self is Fault.SILENT and ours)
                or self is Fault.ALL_SILENT
                or (self is Fault.ONE_LEFT and "/cam0/" not in sent.key)
            ):
                yield sent

    def _stream(self, scene: Scene) -> Iterator[Sent]:
        kind = {
            Fault.KNOCKED: replace(KNOCKED, turn_deg=0.6),
            Fault.CLOCK_STEPPED: replace(CLOCK_STEPPED, step_s=0.15),
        }.get(self)
        if kind is None:
            return messages(scene)
        return chain(state_messages(scene), tracks_messages(scene, faulty_frames(scene, kind, EVENT_S)))


def _flooded(payload: bytes, scene: Scene) -> bytes:
    tracks = msgspec.json.decode(payload, type=Tracks)
    if not tracks.detections:
        return payload
    rng = np.random.default_rng(tracks.seq)
    wild = [
        msgspec.structs.replace(tracks.detections[0], track=10_000 + k, u_px=float(u), v_px=float(v))
        for k, (u, v) in enumerate(rng.uniform(0, 1000, (100, 2)))
    ]
    return encode(msgspec.structs.replace(tracks, detections=tracks.detections + wild))


def _frozen(payload: bytes, scene: Scene) -> bytes:
    tracks = msgspec.json.decode(payload, type=Tracks)
    first = msgspec.json.decode(next(s.payload for s in messages(scene) if s.key.endswith("cam2/tracks")), type=Tracks)
    return encode(msgspec.structs.replace(tracks, detections=first.detections))


def _moved(payload: bytes, by_ns: int) -> bytes:
    tracks = msgspec.json.decode(payload, type=Tracks)
    return encode(msgspec.structs.replace(tracks, t_unix_ns=tracks.t_unix_ns + by_ns))


def inject(fault: Fault, spec: Spec = SPEC) -> Fed:
    scene = make(spec)
    fed, at_ns = Fed(station_for(scene), scene), T0_UNIX_NS
    for sent in fault.apply(scene):
        network = fed.station.calibration.network
        if network is not None and len(network.cameras) == spec.cameras:
            fed.solves = False  # the solver of the tests knows only the healthy network
        while at_ns < sent.arrival_ns - NS // 5:  # time passes in silence too
            at_ns += NS // 10
            fed.tick(at_ns)
        at_ns = sent.arrival_ns
        fed.take(sent)
    for late in range(1, 40):
        fed.tick(at_ns + late * NS // 10)
    return fed


@pytest.mark.parametrize("fault", [Fault.KNOCKED, Fault.CLOCK_STEPPED, Fault.FROZEN], ids=lambda f: f.name)
def test_a_camera_that_lies_is_left_out_by_name_and_the_others_go_on(fault: Fault) -> None:
    fed = inject(fault)
    assert list(fed.station.calibration.suspects) == ["cam2"], fault.value
    suspect_s = next(at_s for at_s, phase in fed.phases if phase == "suspect")
    assert EVENT_S < suspect_s < EVENT_S + 6.0, fault.value
    after = [target for at_s, target in fed.sent if at_s > suspect_s + 1.0]
    assert after, fault.value
    assert all("cam2" not in target.cameras for target in after)
    assert fed.errors_m(after_s=suspect_s + 1.0).max() < 1.0


@pytest.mark.parametrize("fault", [Fault.KNOCKED, Fault.CLOCK_STEPPED], ids=lambda f: f.name)
def test_three_cameras_that_disagree_send_nothing_until_they_are_calibrated_again(fault: Fault) -> None:
    fed = inject(fault, replace(SPEC, cameras=3))
    station = fed.station
    assert station.calibration.suspects == {}, "nobody is named"
    assert station.calibration.trusted == set()
    suspect_s = next(at_s for at_s, phase in fed.phases if phase == "suspect")
    assert EVENT_S < suspect_s < EVENT_S + 6.0
    assert all(target.state == "lost" for at_s, target in fed.sent if at_s > suspect_s), "their ends alone are said"
    assert {target.track for _, target in fed.sent} == {t.track for _, t in fed.sent if t.state == "lost"}
    assert station.standing.reason.startswith("no position is sent: these cameras disagree: cam0, cam1, cam2")
    assert station.standing.action
    assert station.health is not None
    assert next(item.level for item in station.health.items if item.name == "calibration") == "fail"
    kept_ns = min(window.observations().t_unix_ns.min() for window in station.window.cameras.values())
    assert kept_ns > T0_UNIX_NS + (EVENT_S - 3.0) * NS, "what is solved from next was seen since"
    solved = Solved(fed.scene.network, 0.1)
    assert station.solved(SolveResult(station.calibration._jobs, solved, None, 1.0)) is not None
    assert station.calibration.trusted == fed.scene.network.ids


def test_a_calibration_that_comes_while_rays_contradict_each_other_is_not_put_in_force() -> None:
    """It would be bent towards the fault, and the guard would begin anew with it."""
    fed = Fed(station_for(make(SPEC)), make(SPEC))
    refused = None
    for sent in Fault.KNOCKED.apply(fed.scene):
        station = fed.station
        if fed.solves and station.calibration.network is not None and len(station.calibration.network.cameras) == 4:
            fed.solves = False
        if station.guard.doubt is not None and not station.calibration.suspects:
            before = station.calibration.network
            bent = replace(fed.scene.network, rms_px=0.9)
            refused = station.solved(SolveResult(station.calibration._jobs, Solved(bent, 0.1), None, 1.0)) is None
            assert station.calibration.network is before
        fed.take(sent)
    assert refused, "else nothing was on trial"
    assert list(fed.station.calibration.suspects) == ["cam2"]


def test_while_rays_contradict_each_other_positions_are_as_uncertain_as_that_could_make_them() -> None:
    """Who is wrong is not known yet; that somebody is, is."""
    fed = Fed(station_for(make(SPEC)), make(SPEC))
    calm, doubted = [], []
    for sent in Fault.KNOCKED.apply(fed.scene):
        station = fed.station
        if fed.solves and station.calibration.network is not None and len(station.calibration.network.cameras) == 4:
            fed.solves = False
        count, doubt, named = len(fed.sent), station.guard.doubt, bool(station.calibration.suspects)
        fed.take(sent)
        if not named:
            (calm if doubt is None else doubted).extend(t for _, t in fed.sent[count:] if t.state == "confirmed")
    assert doubted, "else nothing was on trial"
    # Half a degree is a metre at 100 m; the rays of the camera may bend a position by twice that.
    assert np.median([target.sigma_m for target in calm]) < 0.5
    assert min(target.sigma_m for target in doubted[5:]) > 0.5


@pytest.mark.parametrize("fault", [Fault.SILENT, Fault.FLOODED], ids=lambda f: f.name)
def test_a_camera_that_does_not_help_does_not_harm(fault: Fault) -> None:
    fed = inject(fault)
    assert fed.sent[-1][0] > SPEC.duration_s - 0.5, fault.value
    assert fed.errors_m(after_s=EVENT_S).max() < 1.0


@pytest.mark.parametrize("fault", [Fault.ALL_SILENT, Fault.ONE_LEFT], ids=lambda f: f.name)
def test_what_nobody_sees_ends_and_its_end_is_said(fault: Fault) -> None:
    fed = inject(fault)
    ends = [target.track for _, target in fed.sent if target.state == "lost"]
    assert sorted(ends) == [1, 2], fault.value
    assert max(at_s for at_s, _ in fed.sent) < (SPEC.duration_s + 4 if fault is Fault.ONE_LEFT else EVENT_S + 3.5)


def test_all_clocks_set_back_stops_everything_until_rays_agree_again() -> None:
    fed = inject(Fault.ALL_CLOCKS_BACK)
    stopped_s = next(at_s for at_s, phase in fed.phases if phase == "collecting" and at_s > EVENT_S)
    assert stopped_s < EVENT_S + 1.5, Fault.ALL_CLOCKS_BACK.value
    assert not [at_s for at_s, _ in fed.sent if EVENT_S + 0.3 < at_s < EVENT_S + 0.8], Fault.ALL_CLOCKS_BACK.value


def test_live_and_replayed_run_give_the_same_targets(tmp_path) -> None:  # type: ignore[no-untyped-def]
    """Through a real recording: messages as they came, networks where they came into force."""
    scene = make(replace(SPEC, duration_s=10.0))
    live, recorder = Fed(station_for(scene), scene), Recorder(tmp_path, SITE, min_free_mb=1)
    in_force = None
    for sent in messages(scene):
        recorder.write(sent.key, sent.payload, sent.arrival_ns)
        live.take(sent)
        if live.station.calibration.network is not in_force:
            in_force = live.station.calibration.network
            assert in_force is not None
            text = msgspec.json.encode({"network_toml": to_toml(in_force)})
            recorder.write(f"skyfix/1/{SITE}/station/calibration", text, sent.arrival_ns)
    recorder.close()
    assert recorder.path is not None
    again = replay(station_for(scene), recorder)
    assert len(live.sent) > 100
    assert again == [target.message() for _, target in live.sent]


def replay(station: Station, recorder: Recorder) -> list[msgspec.Struct]:
    """What a station sends when it is given a recording."""
    assert recorder.path is not None
    sent = []
    for message in recording.read(recorder.path):
        if message.key.endswith("/calibration"):
            station.adopt(from_toml(msgspec.json.decode(message.payload)["network_toml"]))
        else:
            sent += [t.message() for t in station.handle(message.key, message.payload, message.t_arrival_ns)]
            sent += [t.message() for t in station.tick(message.t_arrival_ns).targets]
    return sent
