"""The training: gradients through the metal, mass, the loop in torch against the laws in numpy, resuming, export."""

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip('torch', reason='training needs torch')

from waam_adapt import cli  # noqa: E402
from waam_adapt.laws import explicit as laws  # noqa: E402
from waam_adapt.laws import features, net, net_file  # noqa: E402
from waam_adapt.training import curves, deposit, recorded, rollout, scenes, train  # noqa: E402
from waam_adapt.training.loop import TrainingError  # noqa: E402
from waam_adapt.training.unet import UNet, arrays  # noqa: E402
from waam_adapt.types import RATIO_HIGH, RATIO_LOW, CorrectionInput  # noqa: E402

SMALL = train.Settings(
    steps=6,
    batch=3,
    unroll=2,
    warm=1,
    widths=(4, 4, 4),
    check_every=3,
    check_batches=1,
    check_layers=4,
)


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)


@pytest.fixture(scope='module')
def batch():
    return scenes.batch((5, 1), 4, 4)


def doubles(b: scenes.Batch) -> tuple[deposit.Pool, deposit.Stations]:
    s = b.layers[0]
    pool = deposit.Pool(*(v.double() for v in vars(b.pool).values()))
    fields = {k: v.double() if v.is_floating_point() else v for k, v in vars(s).items()}
    return pool, deposit.Stations(**fields)


def test_gradient_through_the_metal_is_that_of_finite_differences(batch):
    pool, s = doubles(batch)
    rng = np.random.default_rng(0)
    ratio = torch.from_numpy(rng.uniform(0.8, 1.2, batch.z.shape)).requires_grad_()
    weight = torch.from_numpy(rng.normal(size=batch.z.shape))
    noise = batch.noise[0].double()

    def value(r: torch.Tensor) -> torch.Tensor:
        volume = deposit.along_bead(pool, s, deposit.driven(pool, s, deposit.sample(r, s)), noise)
        return (weight * deposit.deposit(batch.z.double(), pool, s, volume)).sum()

    (gradient,) = torch.autograd.grad(value(ratio), ratio)
    for _ in range(5):
        way = torch.from_numpy(rng.normal(size=batch.z.shape))
        numeric = (value(ratio + 1e-6 * way) - value(ratio - 1e-6 * way)) / 2e-6
        assert float(numeric.detach()) == pytest.approx(float((gradient * way).sum()), rel=1e-4)


def test_metal_is_conserved_along_the_bead_and_on_the_surface(batch):
    pool, s = doubles(batch)
    one = torch.ones_like(pool.exponent)
    flat = replace(pool, exponent=one, conserved=one)
    volume = deposit.along_bead(flat, s, torch.ones_like(s.metal), torch.zeros_like(s.metal))
    fed = pool.efficiency[s.scene] * s.metal
    for scene in range(4):
        mine = s.scene == scene
        assert float(volume[mine].sum()) == pytest.approx(float(fed[mine].sum()), rel=1e-9)
    z = batch.z.double()
    grown = (deposit.deposit(z, pool, s, volume) - z).sum((1, 2))
    for scene in range(4):
        assert float(grown[scene]) == pytest.approx(float(volume[s.scene == scene].sum()), rel=1e-9)


def test_start_is_high_and_end_is_low_and_hollows_take_more(batch):
    pool, s = doubles(batch)
    strong = replace(
        pool, hump=torch.full_like(pool.hump, 0.5), crater=torch.full_like(pool.crater, 0.6)
    )
    volume = (
        deposit.along_bead(strong, s, torch.ones_like(s.metal), torch.zeros_like(s.metal)) / s.metal
    )
    first = s.bead == 0
    v = volume[first]
    assert v[0] > v[len(v) // 2] > v[-1]
    z = torch.zeros_like(batch.z.double())
    row, col = (int(round(float(x))) for x in s.where[first][len(v) // 2])
    z[0, row, col] = -0.5
    dent = deposit.deposit(z, pool, s, volume * s.metal) - z
    even = deposit.deposit(torch.zeros_like(z), pool, s, volume * s.metal)
    assert dent[0, row, col] > even[0, row, col] + 0.05


def test_explicit_law_in_the_loop_is_the_damped_inverse():
    b = scenes.batch((3, 2), 6, 2)
    rng = np.random.default_rng(1)
    z = torch.from_numpy(rng.normal(0, 0.1, b.z.shape)).float()
    known = b.footprint.numpy() & (rng.random(b.z.shape) > 0.05)
    ours = rollout.height_request(b, -z, known, 0).numpy()
    for i in range(6):
        h = float(b.height[i])
        cos2a, sin2a = (float(b.fixed[0][i, k, 0, 0]) for k in (2, 3))
        angle = 0.5 * np.arctan2(sin2a, cos2a)
        direction = (np.cos(angle), np.sin(angle)) if np.hypot(cos2a, sin2a) > 0 else (0.0, 0.0)
        direction = tuple(0.0 if abs(x) < 1e-6 else x for x in direction)
        request = CorrectionInput(
            z=np.where(known[i], z[i].numpy() * h, np.nan), target=np.zeros(b.z.shape[1:]),
            planned=b.planned[i].numpy() * h, resolution=1.5e-3, bead_width=6e-3, k_gain=0.3,
            sigma=np.full(b.z.shape[1:], float(b.sigma[i]) * h), direction=direction,
        )  # fmt: skip
        inside = b.footprint[i].numpy()
        wish = laws.DampedInverse(gain=float(b.gain[i])).height_request(request)
        expected = np.clip(1 + ours[i], RATIO_LOW, RATIO_HIGH)
        assert wish.ratio[inside] == pytest.approx(expected[inside], abs=2e-4)


def test_numpy_network_is_the_torch_network():
    torch.manual_seed(3)
    network = UNet((4, 8, 8))
    torch.nn.init.normal_(network.head.weight)
    torch.nn.init.normal_(network.doubt.weight)
    x = np.random.default_rng(0).normal(size=(features.CHANNELS, 40, 48)).astype(np.float32)
    with torch.no_grad():
        reference = [a[0].numpy() for a in network(torch.from_numpy(x)[None])]
    for a, b in zip(net.Network(arrays(network), {}, '')(x), reference, strict=True):
        assert a == pytest.approx(b, abs=2e-5)


def test_features_of_the_loop_are_those_of_the_law(batch):
    """The network must be asked in service what it was asked in training."""
    i, h = 0, float(batch.height[0])
    known = batch.footprint.numpy()
    share = 0.1 * batch.footprint.float()
    error = -batch.z
    ours = rollout.inputs(
        batch, share, error, torch.from_numpy(known).float(), torch.zeros_like(error), 2
    )[i].numpy()
    cos2a, sin2a = (
        ours[features.NAMES.index('cos2a')][0, 0],
        ours[features.NAMES.index('sin2a')][0, 0],
    )
    angle = 0.5 * np.arctan2(sin2a, cos2a)
    unknown = np.hypot(cos2a, sin2a) == 0
    request = CorrectionInput(
        z=batch.z[i].numpy().astype(float) * h, target=np.zeros(batch.z.shape[1:]),
        planned=batch.planned[i].numpy().astype(float) * h, resolution=1.5e-3, bead_width=6e-3, k_gain=0.3,
        sigma=np.full(batch.z.shape[1:], float(batch.sigma[i]) * h),
        direction=(0.0, 0.0) if unknown else (np.cos(angle), np.sin(angle)),
        shortfall=share[i].numpy().astype(float), experience=1,
    )  # fmt: skip
    seen = features.build(request, np.zeros(request.z.shape)).x
    skip = {'starts', 'ends', 'paths', 'temperature'}
    for name, a, b in zip(features.NAMES, seen, ours, strict=True):
        if name not in skip:
            assert a == pytest.approx(b, abs=1e-4), name


def test_resumed_training_goes_on_to_the_same_bits(tmp_path):
    whole = train.Trainer(SMALL)
    for _ in range(3):
        whole.step()
    first = train.Trainer(SMALL)
    first.step()
    first.save(tmp_path / 'checkpoint.npz')
    second = train.Trainer(SMALL)
    second.resume(tmp_path / 'checkpoint.npz')
    for _ in range(2):
        second.step()
    assert second.progress.loss == whole.progress.loss
    for k, v in arrays(whole.net).items():
        assert v.tobytes() == arrays(second.net)[k].tobytes(), k
    with pytest.raises(TrainingError, match='batch = 3, not 5'):
        train.Trainer(replace(SMALL, batch=5)).resume(tmp_path / 'checkpoint.npz')


def test_training_lowers_the_error_of_its_own_scenes():
    """A few dozen steps on one fixed batch: the gradient points the right way."""
    torch.manual_seed(0)
    network = UNet((4, 8, 8))
    optimizer = torch.optim.Adam(network.parameters(), 1e-2)
    values = []
    for _ in range(15):
        b = scenes.batch((11, 0), 3, 2)
        value = rollout.loss(rollout.run(b, network, 2), b.judged)
        optimizer.zero_grad()
        value.backward()
        optimizer.step()
        values.append(float(value.detach()))
    assert values[-1] < values[0] - 0.1


def test_imitation_of_the_ideal_control_is_the_simpler_loss(batch):
    """A surface as planned asks for the plan, one that lacks a tenth of a layer for a tenth more."""
    flat = torch.where(batch.footprint, batch.planned, 0.0)
    at = batch.footprint & batch.judged.bool()
    assert torch.allclose(rollout.ideal(batch, flat, 1)[at], torch.ones(1))
    assert torch.allclose(rollout.ideal(batch, 0.9 * flat, 1)[at], torch.full((1,), 1.1))


def test_each_loss_makes_smaller_what_it_names():
    def after(kind: str) -> tuple[float, float]:
        torch.manual_seed(0)
        network = UNet((4, 8, 8))
        optimizer = torch.optim.Adam(network.parameters(), 1e-2)
        for _ in range(25):
            b = scenes.batch((11, 0), 3, 1)
            layers = rollout.run(b, network, 1)
            optimizer.zero_grad()
            rollout.loss(layers, b.judged, kind).backward()
            optimizer.step()
        one = layers[0]
        return float(one.square.log().mean().detach()), float(one.imitated.mean().detach())

    height, imitation = after('height'), after('imitation')
    assert height[0] < imitation[0] - 0.05
    assert imitation[1] < 0.8 * height[1]


def test_untrained_network_is_the_explicit_law_in_the_loop():
    with torch.no_grad():
        runs = [rollout.run(scenes.batch((2, 2), 3, 3), n, 3, 3) for n in (UNet((4, 4, 4)), None)]
    for a, b in zip(*runs, strict=True):
        assert a.square.numpy() == pytest.approx(b.square.numpy(), rel=1e-4)


def test_command_trains_exports_and_resumes(tmp_path, capsys):
    parser = __import__('argparse').ArgumentParser()
    cli.register(parser.add_subparsers())
    common = [
        'train',
        '--out',
        str(tmp_path / 'net'),
        '--batch',
        '2',
        '--unroll',
        '1',
        '--check-every',
        '2',
    ]
    args = parser.parse_args([*common, '--steps', '2'])
    assert args.run_command(args) == 0
    out = tmp_path / 'net' / 'correction.npz'
    loaded = net_file.load(out)
    assert loaded.card['training']['steps'] == 2
    assert set(loaded.card['seen']) == set(features.SUMMARIES)
    assert loaded.digest in out.with_suffix('.md').read_text()
    assert (tmp_path / 'net' / 'curves.png').read_bytes()[:4] == b'\x89PNG'
    assert 'best at step 2' in capsys.readouterr().out
    args = parser.parse_args([*common, '--steps', '2'])
    assert args.run_command(args) == 1
    assert '--resume' in capsys.readouterr().err


def test_recorded_surface_is_cut_and_scaled_to_the_training_grid():
    z = np.full((200, 300), 1e-3)
    planned = np.zeros(z.shape)
    planned[50:150, 50:250] = 2e-3
    request = CorrectionInput(z, np.zeros(z.shape), planned, 0.5e-3, 6e-3, 0.3)
    r = recorded.surface(request)
    assert r.error.shape == (scenes.SIZE, scenes.SIZE)
    assert r.error == pytest.approx(-0.5)
    assert 0.3 < r.footprint.mean() < 1
    assert recorded.surface(replace(request, z=np.full(z.shape, np.nan))) is None


def test_scenes_start_from_recorded_surfaces():
    wave = np.sin(np.arange(scenes.SIZE) / 3)[None, :] * np.ones((scenes.SIZE, 1))
    r = scenes.Recorded(wave, np.ones(wave.shape, bool))
    b = scenes.batch((4, 4), 12, 1, [r])
    same = [np.corrcoef(z.ravel(), -wave.ravel())[0, 1] > 0.999 for z in b.z.numpy()]
    assert 2 <= sum(same) <= 10


def test_curves_are_drawn_without_any_check(tmp_path):
    curves.draw([1.0, 0.5], [], train.SHOWN, tmp_path / 'c.png')
    assert (tmp_path / 'c.png').stat().st_size > 1000
