"""How fast frames are parsed and decisions made, without ROS or ports."""

from collections.abc import Callable
import json
from pathlib import Path
import time

from esi_drive_bridge.protocol import Layout
from esi_drive_bridge.protocol import Status
from esi_drive_bridge.protocol import status_parser
from fort_vsc_bridge.protocol import parser
from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit
from safety_mux.limits import JointLimiter
from safety_mux.protocol import EStopSource
from safety_mux.protocol import MuxConfig
from safety_mux.protocol import Operator

VECTORS = Path(__file__).parent.parent / 'test' / 'vectors'


def per_second(action: Callable[[], int], seconds: float = 1.0) -> float:
    """Return how many items a second ``action`` handles; it returns how many it did."""
    done, start = 0, time.perf_counter()
    while (elapsed := time.perf_counter() - start) < seconds:
        done += action()
    return done / elapsed


def fort_vsc() -> int:
    vectors = json.loads((VECTORS / 'fort_vsc.json').read_text())['serial']
    stream = b''.join(bytes.fromhex(v['hex']) for v in vectors if v['is'] != 'host heartbeat') * 50
    return len(parser().feed(stream, 0.0))


def esi_drive() -> int:
    vectors = json.loads((VECTORS / 'esi.json').read_text())['status_derived']
    stream = b''.join(bytes.fromhex(v['hex']) for v in vectors) * 200
    return len(status_parser(Layout.DUAL).feed(stream, 0.0))


def mux() -> int:
    config = MuxConfig(
        joints=2,
        sources=(EStopSource('remote'), EStopSource('drive')),
        operators=(Operator('remote', 1),),
    )
    limiter = JointLimiter([JointLimit(10.0, 20.0, 40.0)] * 2)
    arbiter = Arbiter(config, limiter, 0.0)
    for tick in range(1000):
        arbiter.estop_message('remote', False, 0.01 * tick)
        arbiter.tick(0.01 * tick)
    return 1000


def main() -> None:
    for name, action in (
        ('VSC frames parsed and decoded', fort_vsc),
        ('ESI status packets parsed and decoded', esi_drive),
        ('mux decisions', mux),
    ):
        print(f'{name}: {per_second(action):,.0f} a second')


if __name__ == '__main__':
    main()
