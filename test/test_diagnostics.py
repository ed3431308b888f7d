"""What diagnostics say of a link: how much of what comes is damaged."""

import pytest

from bridge_core.framing import Counters
from bridge_core.report import Damage


@pytest.mark.parametrize(
    ('frames', 'checksum_errors', 'discarded_bytes', 'share'),
    [
        (80, 20, 240, 0.2),
        (100, 0, 0, 0.0),
        (100, 1, 2, 0.0),  # an accident
        (40, 0, 2_000_000, 0.9998),
        (0, 0, 0, 0.0),
    ],
    ids=['a fifth of the frames', 'sound', 'a single error', 'garbage between', 'silence'],
)
def test_share_of_damage(
    frames: int, checksum_errors: int, discarded_bytes: int, share: float
) -> None:
    counters = Counters()
    damage = Damage(counters)
    damage.update(10.0)
    counters.frames, counters.checksum_errors = frames, checksum_errors
    counters.discarded_bytes = discarded_bytes
    counters.bytes = 12 * frames + discarded_bytes
    damage.update(11.0)
    assert damage.share == 0.0  # the window is not over
    damage.update(12.0)
    assert damage.share == pytest.approx(share, abs=1e-3)
    assert (damage.share >= Damage.LIMIT) == (share >= Damage.LIMIT)
    damage.update(14.0)
    assert damage.share == 0.0  # of the last window only
