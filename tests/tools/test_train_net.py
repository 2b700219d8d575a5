"""The training itself, small: losses that fall, exports that equal the net. Needs torch, which a box does not have."""

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the train extra is not installed: pip install skyfix[train]")
onnx = pytest.importorskip("onnx", reason="the train extra is not installed: pip install skyfix[train]")

import onnxruntime as ort  # noqa: E402

from edge.common.errors import SkyfixError  # noqa: E402
from tools.train import __main__ as program  # noqa: E402
from tools.train.compose import BOX_VALUES, MAX_BOXES, Composer  # noqa: E402
from tools.train.export import About, export  # noqa: E402
from tools.train.footage import Material  # noqa: E402
from tools.train.loop import Schedule, train  # noqa: E402
from tools.train.loss import centres, losses  # noqa: E402
from tools.train.mine import SIZE_KNOTS, Found, SigmaFit, fit_sigma  # noqa: E402
from tools.train.net import SkyNet, cells  # noqa: E402


def test_cells_keep_every_pixel_where_it_was() -> None:
    image = torch.arange(2 * 8 * 16 * 3).reshape(2, 8, 16, 3) % 256
    packed = cells(image.to(torch.uint8))
    assert packed.shape == (2, 48, 2, 4)
    # Pixel (row 5, column 10) of frame 1: cell (1, 2), row 1 and column 2 inside it.
    channel = (1 * 4 + 2) * 3 + 1
    assert float(packed[1, channel, 1, 2]) == pytest.approx((float(image[1, 5, 10, 1]) - 128) / 64)


def test_a_perfect_answer_costs_least() -> None:
    boxes = torch.zeros(1, MAX_BOXES, BOX_VALUES)
    boxes[0, 0] = torch.tensor([21.3, 34.8, 6.0, 4.0, 2.0, 1.0, 1.0, 1.0, 1.0])
    raw = torch.zeros(1, 10, 16, 16)
    raw[:, 0] = -9
    raw[0, 0, 8, 5] = 9
    centre = centres(raw)[0][0, :, 8, 5]
    raw[0, 1:3, 8, 5] = (boxes[0, 0, :2] - centre) / 4
    raw[0, 5] = -3
    good = losses(raw, boxes)
    off = raw.clone()
    off[0, 1, 8, 5] += 0.5
    missed = raw.clone()
    missed[0, 0, 8, 5] = -9
    false = raw.clone()
    false[0, 0, 2, 2] = 9
    assert losses(off, boxes).centre > good.centre
    assert losses(missed, boxes).heat > good.heat + 1
    assert losses(false, boxes).heat > good.heat + 1


def test_a_loose_label_teaches_no_centre() -> None:
    boxes = torch.zeros(1, MAX_BOXES, BOX_VALUES)
    boxes[0, 0] = torch.tensor([21.3, 34.8, 6.0, 4.0, 2.0, 0.0, 0.0, 1.0, 1.0])
    found = losses(torch.randn(1, 10, 16, 16), boxes)
    assert float(found.centre) == float(found.size) == float(found.label) == 0
    assert float(found.heat) > 0


def test_what_cannot_be_seen_is_neither_object_nor_background() -> None:
    boxes = torch.zeros(1, MAX_BOXES, BOX_VALUES)
    boxes[0, 0] = torch.tensor([21.3, 34.8, 6.0, 4.0, 2.0, 1.0, 1.0, 1.0, 0.0])
    raw = torch.zeros(1, 10, 16, 16, requires_grad=True)
    losses(raw, boxes).total().backward()
    taught = raw.grad.abs().sum(dim=1)[0] > 0
    assert not taught[7:10, 4:7].any(), "the object's own cell (8, 5) and those about it"
    taught[6:11, 3:8] = True
    assert taught.all(), "the rest is background"


def test_sigma_is_brought_to_the_truth() -> None:
    random = np.random.default_rng(4)
    log_sigma = random.uniform(-2, 1, 6000).astype(np.float32)
    log_size = random.uniform(1, 3.6, 6000).astype(np.float32)
    offset = 0.4 + 0.3 * np.sin(3 * log_size)  # to and fro
    error = random.normal(0, 1, (6000, 2)) * np.exp(offset + 0.8 * log_sigma)[:, None]
    found = Found(error.astype(np.float32), log_sigma, log_size)
    fit = fit_sigma(found)
    # 12000 values, 2000 or so to each offset: known to 0.02; a sine between knots is off by 0.03 more.
    assert fit.slope == pytest.approx(0.8, abs=0.04)
    assert fit.offsets == pytest.approx(0.4 + 0.3 * np.sin(3 * np.array(SIZE_KNOTS)), abs=0.12)
    assert found.normalised(fit) == pytest.approx(1, abs=0.04)


def test_too_little_found_is_said() -> None:
    empty = Found(np.zeros((3, 2), np.float32), np.zeros(3, np.float32), np.zeros(3, np.float32))
    with pytest.raises(SkyfixError, match="too few"):
        fit_sigma(empty)


def test_a_training_learns_and_its_files_say_the_same_as_the_net(tmp_path: Path) -> None:
    torch.manual_seed(1)
    torch.set_num_threads(1)
    material = Material(backgrounds=[np.full((160, 160, 3), 120, np.uint8)])
    heat = []
    net = train(SkyNet(4), Composer(material, 1), Schedule(60, batch=8), lambda net, line: heat.append(line))
    # A composer of its own, so that the two see the same samples.
    stacks, boxes = Composer(material, 2).batch(32)
    with torch.no_grad():
        after = losses(net.eval()(cells(torch.from_numpy(stacks))), torch.from_numpy(boxes))
        before = losses(SkyNet(4).eval()(cells(torch.from_numpy(stacks))), torch.from_numpy(boxes))
    assert after.total() < before.total()
    about = About(("drone", "bird", "aeroplane", "helicopter"), "a test", 1)
    export(net, SigmaFit(1.0, (0.2,) * len(SIZE_KNOTS)), tmp_path / "model", about, Composer(material, 3))
    image = stacks[:2, :72, :64].copy()
    with torch.no_grad():
        raw = net(cells(torch.from_numpy(image)))
    for name, tolerance in (("model-fp32.onnx", 1e-4), ("model.onnx", 0.05)):
        session = ort.InferenceSession(str(tmp_path / name))
        found_boxes, scores, _, sigma = session.run(None, {"image": image})
        assert scores[:, 0] == pytest.approx(torch.sigmoid(raw[:, 0]).flatten(1).amax(1).numpy(), abs=tolerance)
        assert "skyfix" in session.get_modelmeta().custom_metadata_map
        assert found_boxes.shape == (2, 64, 4)
        assert (sigma > 0).all()


def test_nothing_to_train_on_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        program.main(["--out", "model"])
    assert caught.value.code == 2
    assert "--clips or --yolo" in capsys.readouterr().err


def test_a_missing_folder_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert program.main(["--clips", str(tmp_path / "none"), "--out", str(tmp_path / "m")]) == 1
    assert "split" in capsys.readouterr().err
