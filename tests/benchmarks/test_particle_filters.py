"""What a particle-step costs, on the ballistic model: for every particle filter, over particles, over runs, and in memory.

The floor of a filter is the time that NumPy needs to draw the normal numbers that it consumes, and no more.
"""

import subprocess
import sys
import time

import numpy as np
import pytest

from cases import CASES
from estimators import ESTIMATORS
from suite import parameters
from tests.benchmarks.timing import TIMER, clock, floor, in_turns, normals_drawn, rounds_within

pytestmark = pytest.mark.benchmark(timer=TIMER)

CASE = CASES["ballistic/1"]
MODEL = CASE.model
COUNT, RUNS = 8000, 4
FILTERS = [
    name for name, entry in ESTIMATORS.items() if "particles" in parameters.fields(entry) and entry.accepts(MODEL) is None
]
MEMORY = """
import sys
from cases import CASES
from estimators import ESTIMATORS
case = CASES["ballistic/1"]
assert ESTIMATORS[sys.argv[1]].run(case.model, case.simulate(1, seed=1).y[:3], seed=1).ok.all()
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


@pytest.fixture(scope="module")
def y() -> np.ndarray:
    """Measurements [T, m, 1] of one run."""
    return CASE.simulate(runs=1, seed=1).y


def sized(name: str, count: int):
    return ESTIMATORS[f"{name}[particles={count}]"]


@pytest.mark.parametrize("name", FILTERS)
def test_cost_of_a_particle_step(benchmark, y, name: str) -> None:
    chosen, bootstrap = sized(name, COUNT), sized("bootstrap", COUNT)
    y = np.repeat(y, RUNS, axis=2)
    seconds_a_step = clock(lambda: chosen.run(MODEL, y[:2], seed=1)) / 2
    steps = int(np.clip(2 / seconds_a_step, 2, len(y)))  # the slow ones get fewer

    def subject() -> None:
        assert chosen.run(MODEL, y[:steps], seed=1).ok.all()

    shapes = normals_drawn(subject)
    rivals = {"floor": floor(shapes), "bootstrap": lambda: bootstrap.run(MODEL, y[:steps], seed=1)}
    turns = in_turns(benchmark, subject, rivals, rounds_within(6, subject))
    per_particle_step = 1e9 / (COUNT * RUNS * steps)
    benchmark.group = f"ballistic/1, {RUNS} runs of {COUNT} particles"
    benchmark.extra_info |= {
        "table": f"Particle filters on ballistic/1, {RUNS} runs of {COUNT} particles, one thread; floor: their normal numbers",
        "filter": name,
        "steps": steps,
        "ns_per_particle_step": per_particle_step * float(np.median(turns.subject)),
        "normals_per_particle_step": sum(map(np.prod, shapes)) / (COUNT * RUNS * steps),
        "floor_ns": per_particle_step * turns.medians()["floor"],
        "ratio_to_floor": turns.ratio("floor"),
        "ratio_to_bootstrap": turns.ratio("bootstrap"),
    }


@pytest.mark.parametrize("name", ["bootstrap", "isir"])
def test_cost_over_the_number_of_particles(benchmark, y, name: str) -> None:
    steps = 10
    batches = {1000: 40, 8000: 5, 100_000: 1, 1_000_000: 1}  # runs computed together

    def job(count: int, runs: int):
        chosen, same = sized(name, count), np.repeat(y[:steps], runs, axis=2)
        return lambda: chosen.run(MODEL, same, seed=1)

    jobs = {str(count): job(count, runs) for count, runs in batches.items()}
    largest = jobs.pop("1000000")
    turns = in_turns(benchmark, largest, jobs, rounds_within(12, largest))
    seconds = {**turns.medians(), "1000000": float(np.median(turns.subject))}
    cost = {count: 1e9 * seconds[str(count)] / (count * runs * steps) for count, runs in batches.items()}
    benchmark.group = "ballistic/1, a million particles"
    benchmark.extra_info |= {
        "table": "ns per particle-step over the number of particles: 40 runs of 1000, 5 of 8000, 1 of more; 10 steps",
        "filter": name,
        **{f"N={count}": value for count, value in cost.items()},
        "largest_to_smallest": max(cost.values()) / min(cost.values()),
    }


@pytest.mark.parametrize("name", ["bootstrap", "isir"])
def test_cost_over_the_number_of_runs(benchmark, y, name: str) -> None:
    steps, many = 20, 100
    chosen, same = sized(name, 1000), np.repeat(y[:steps], many, axis=2)

    def job(runs: int):
        return lambda: chosen.run(MODEL, same[:, :, :runs], seed=1)

    turns = in_turns(benchmark, job(many), {"1": job(1), "10": job(10)}, rounds_within(6, job(many)))
    seconds = {**turns.medians(), str(many): float(np.median(turns.subject))}
    benchmark.group = f"ballistic/1, 1000 particles, {many} runs"
    benchmark.extra_info |= {
        "table": "µs per run-step over the number of runs, 1000 particles, 20 steps",
        "filter": name,
        **{f"runs={runs}": 1e6 * value / (int(runs) * steps) for runs, value in seconds.items()},
        "hundred_to_ten": turns.ratio("10") / 10,
    }


@pytest.mark.skipif(sys.platform != "linux", reason="peak memory is read from /proc")
@pytest.mark.benchmark(timer=time.perf_counter)
@pytest.mark.parametrize("name", ["bootstrap", "isir"])
def test_a_million_particles_fit_into_a_gibibyte(benchmark, name: str) -> None:
    # Not from getrusage: a child's ru_maxrss starts at what its parent held.
    command = [sys.executable, "-c", MEMORY, f"{name}[particles=1000000]"]
    done = benchmark.pedantic(subprocess.run, (command,), {"capture_output": True, "text": True, "check": True}, rounds=1)
    peak = int(done.stdout) / 1024
    benchmark.group = "ballistic/1, memory"
    benchmark.extra_info |= {"table": "Peak memory of a process with a million particles", "filter": name, "MiB": peak}
    assert peak < 1024
