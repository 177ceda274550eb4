"""Which blocks are asked for, which are stored already, and what their addresses depend on."""

import dataclasses
from pathlib import Path

import pytest

import cases
from estimators import ESTIMATORS
from suite import parameters, plan, provenance
from suite.effort import BRIEF, FULL
from suite.errors import BadInput
from suite.estimator import told
from suite.published import Experiment
from suite.registry import catalog
from suite.store import Entry

TINY = str(Path(__file__).resolve().parents[1] / "plugins" / "tiny.py")


@pytest.fixture
def known():
    return catalog(ESTIMATORS, cases.MODULES).with_plugins([TINY])


@pytest.fixture
def make(known):
    def make(names, runs=4, size=2, seed=1, entries=(), retry=False, chosen=("tiny",), effort=FULL):
        chosen_cases = known.cases.select(chosen)
        wanted = dict.fromkeys(chosen_cases, known.estimators.select(names))
        return plan.make(known, wanted, dict.fromkeys(chosen_cases, runs), seed, size, entries, retry, effort)

    return make


def entry(block, number=0, failed=0):
    """What the store says of a block."""
    meta = {"version": block.version, "first": block.first, "count": block.count, "failed": failed, "created": f"{number:04}"}
    return Entry(Path(f"{number:04}-{block.address}.parquet"), meta)


def spans(planned, kind=plan.ESTIMATE):
    return [(b.first, b.count) for b in planned.blocks if b.kind == kind]


def test_blocks_cover_all_runs_once(make):
    for runs, size, expected in ((4, 2, [(0, 2), (2, 2)]), (5, 2, [(0, 2), (2, 2), (4, 1)]), (3, 8, [(0, 3)])):
        planned = make(["last"], runs, size)
        assert spans(planned) == spans(planned, plan.TRUTH) == expected
        assert spans(planned, plan.TIMING) == [(0, 1)]


def test_the_paper_profile_runs_the_experiment_of_a_case(known):
    ran = Experiment(runs=7, estimators=("kalman", "boot*[particles=5]"))
    plain = known.cases["linear-gaussian"]
    case = dataclasses.replace(plain, experiment=ran)
    quick, paper = (plan.PROFILES[name] for name in ("quick", "paper"))
    assert (paper.runs_of(case), paper.runs_of(plain), quick.runs_of(case)) == (7, 100, 6)
    assert [parameters.label(e) for e in paper.estimators_of(case, known.estimators)] == ["kalman", "bootstrap[particles=5]"]
    for profile, given in ((paper, plain), (plan.PROFILES["whole"], case)):
        assert profile.estimators_of(given, known.estimators) == list(known.estimators.values())


def test_long_cases_get_fewer_runs_in_the_quick_profile(known):
    """As many run-steps as 12 runs of 50 steps, but no fewer than three runs; the paper profile knows no such thing."""
    case = known.cases["linear-gaussian"]
    long = {steps: dataclasses.replace(case, steps=steps) for steps in (1, 40, 100, 150, 299, 400, 10_000)}
    quick, paper = ({s: plan.PROFILES[name].runs_of(c) for s, c in long.items()} for name in ("quick", "paper"))
    assert quick == {1: 12, 40: 12, 100: 6, 150: 4, 299: 3, 400: 3, 10_000: 3}
    assert set(paper.values()) == {100}
    runs = {long[steps]: quick[steps] for steps in (400, 40)}
    known_to_few = plan.make(known, dict.fromkeys(runs, ()), runs, 1, 6, ())
    assert spans(known_to_few, plan.TRUTH) == [(0, 3), (0, 6), (6, 6)]


def test_large_states_get_fewer_runs_in_the_quick_profile(known):
    """From eight components on in proportion to their square, as a matrix of the state has so many numbers."""
    runs = {n: plan.PROFILES["quick"].runs_of(known.cases[f"high-dimensional/{n}"]) for n in (5, 10, 20, 50)}
    assert {case.name for case in known.cases.values() if len(case.state) != case.model.n} == set()
    assert runs == {5: 12, 10: 12, 20: 600 * 64 // (10 * 400), 50: 3}, "ten steps each; 600 run-steps of eight components"


def left_out(known, case, profile=plan.PROFILES["quick"]):
    return {e.name for e in known.estimators.values() if profile.left_out(e.name, case)}


def test_the_quick_profile_leaves_slow_estimators_out_of_long_cases(known):
    """Each runs up to a size of its own; the few that are fast run on every case."""
    case = known.cases["linear-gaussian"]
    short, middle, long, longer = (left_out(known, dataclasses.replace(case, steps=n)) for n in (60, 61, 200, 201))
    assert short == set()
    assert middle == long == {"progressive", "unscented", "isir", *(n for n in known.estimators if n.startswith("filterpy:"))}
    assert known.estimators.keys() - longer == {"kalman", "ekf", "ukf", "ckf", "bootstrap", "imm-ekf"}
    assert left_out(known, known.cases["high-dimensional/50"]) == longer, "10 steps of 50 components count as 391"
    assert left_out(known, known.cases["high-dimensional/5"]) == set()


def test_what_is_left_out_is_told_with_the_way_to_run_it(known):
    reason = plan.PROFILES["quick"].left_out("progressive", known.cases["re-entry"])
    assert reason.startswith("left out of the profile quick for the time it takes: 2000 steps, 5 components of the state; ")
    assert reason.endswith("`filterbench run --profile whole` or naming the estimator runs it")


def test_every_case_and_every_estimator_runs_in_the_quick_profile_and_refusals_are_said(known):
    quick, run = plan.PROFILES["quick"], set()
    for case in known.cases.values():
        asked = set(quick.estimators_of(case, known.estimators))
        refused = {e for e in known.estimators.values() if e.accepts(told(e, case.model))}
        assert refused <= asked
        assert {e.name for e in asked - refused}.isdisjoint(left_out(known, case))
        assert quick.runs_of(case) >= 3
        run |= {(case.name, e.name) for e in asked - refused}
    assert [{*names} for names in zip(*run, strict=True)] == [known.cases.keys(), known.estimators.keys()]


def test_the_whole_profile_adds_what_quick_left_out(known):
    """Both have the same runs and blocks, so that what quick stored is not run again."""
    case = known.cases["vehicle/1"]
    quick, whole = (plan.PROFILES[name] for name in ("quick", "whole"))
    chosen = known.estimators.select(["ekf", "isir", "imm-ekf"])  # one runs, one is left out, one refuses
    kept = [e for e in quick.estimators_of(case, known.estimators) if e in chosen]
    planned = [
        set(plan.make(known, {case: estimators}, {case: profile.runs_of(case)}, 1, profile.block, ()).blocks)
        for profile, estimators in ((quick, kept), (whole, chosen))
    ]
    assert planned[0] < planned[1]
    assert {b.estimator for b in planned[1] - planned[0]} == {"isir"}
    assert quick.block == whole.block
    assert not any(left_out(known, c, p) for c in known.cases.values() for p in (whole, plan.PROFILES["paper"]))


def test_truth_comes_first_and_timing_last(make):
    kinds = [b.kind for b in make(["last", "kalman"]).blocks]
    assert kinds == ["truth"] * 2 + ["bound"] + ["estimate"] * 4 + ["timing"] * 2


def test_a_bound_is_computed_once_a_case(known, make):
    """Neither runs nor estimators enter it; the case and the seed do."""
    first = make(["last"], chosen=["tiny", "linear-gaussian"])
    entries = [entry(b) for b in first.blocks if b.kind == plan.BOUND]
    assert [(b.case, b.first, b.count) for b in first.blocks if b.kind == plan.BOUND] == [
        ("linear-gaussian", 0, 1),
        ("tiny", 0, 1),
    ]
    assert not spans(make(["kalman"], runs=9, entries=entries, chosen=["tiny", "linear-gaussian"]), plan.BOUND)
    assert len(spans(make(["last"], seed=2, entries=entries), plan.BOUND)) == 1


@pytest.mark.parametrize("kind", [plan.BOUND, plan.TIMING])
def test_what_is_made_once_is_made_again_for_more_effort_but_not_for_less(make, kind):
    brief, full = make(["last"], effort=BRIEF), make(["last"], effort=FULL)
    assert addresses(brief, kind).isdisjoint(addresses(full, kind))
    assert addresses(brief) == addresses(full)
    assert spans(make(["last"], entries=[entry(b) for b in brief.blocks], effort=FULL), kind) == [(0, 1)]
    assert not spans(make(["last"], entries=[entry(b) for b in full.blocks], effort=BRIEF), kind)
    assert not spans(make(["last"], entries=[entry(b) for b in brief.blocks], effort=BRIEF), kind)


def test_addresses_differ(make):
    blocks = make(["*", "bootstrap[particles=5]"], chosen=["*"]).blocks
    assert len({b.address for b in blocks}) == len(blocks)


def test_what_is_stored_is_left_out(make):
    first = make(["last"])
    planned = make(["last"], entries=[entry(b) for b in first.blocks])
    assert (planned.blocks, planned.stored) == ((), 6)


def test_more_runs_need_only_the_missing_ones(make):
    entries = [entry(b) for b in make(["last"], 4, 4).blocks]
    planned = make(["last"], 8, 6, entries=entries)
    assert spans(planned) == [(4, 2), (6, 2)], "blocks begin at multiples of their size"
    assert spans(planned, plan.TIMING) == []
    assert make(["last"], 3, 1, entries=entries).blocks == ()


def test_gaps_are_filled(make):
    blocks = make(["last"], 8, 1).blocks
    planned = make(["last"], 8, 4, entries=[entry(b) for b in blocks if b.first in (1, 2, 6)])
    assert spans(planned) == [(0, 1), (3, 1), (4, 2), (7, 1)]


def test_failed_blocks_run_again_on_demand(make):
    blocks = make(["last"]).blocks
    entries = [entry(b, failed=int(b.kind == plan.ESTIMATE and b.first == 2)) for b in blocks]
    planned = make(["last"], entries=entries)
    assert (planned.blocks, planned.stored_failures) == ((), 1)
    assert spans(make(["last"], entries=entries, retry=True)) == [(2, 2)]


def test_a_later_block_counts_for_an_earlier_one_of_the_same_runs(make):
    """A failed block of four was run again as two of two, which came through."""
    entries = [entry(b, 9, failed=1) for b in make(["last"], 4, 4).blocks if b.kind == plan.ESTIMATE]
    entries += [entry(b, 10) for b in make(["last"], 4, 2).blocks]
    for order in (entries, entries[::-1]):
        assert make(["last"], entries=order, retry=True).blocks == ()


def test_a_refusal_is_planned_once(make):
    planned = make(["last"], 6, chosen=["linear-gaussian"])
    refusals = [b for b in planned.blocks if b.kind == plan.REFUSAL]
    assert [b.reason for b in refusals] == ["it takes one measurement component"]
    assert (planned.cells, planned.refused, spans(planned), spans(planned, plan.TIMING)) == (1, 1, [], [])


@pytest.mark.parametrize(
    ("answer", "words"), [(True, "accepts must return None or the reason as text, got True"), (None, "accepts raised")]
)
def test_accepts_that_does_not_say(known, answer, words):
    class Vague:
        name, reference = "vague", ""

        def accepts(self, model):
            if answer is None:
                raise ArithmeticError("no\nidea")
            return answer

    with pytest.raises(BadInput, match=words):
        plan.make(known, {known.cases["tiny"]: [Vague()]}, {known.cases["tiny"]: 1}, 1, 1, [])


# What an address depends on.


def addresses(planned, kind=plan.ESTIMATE):
    return {b.address for b in planned.blocks if b.kind == kind}


@pytest.fixture
def changed(monkeypatch):
    """Make a module's source look changed."""
    real = provenance._source

    def change(module):
        provenance.fingerprint.cache_clear()
        monkeypatch.setattr(provenance, "_source", lambda name: real(name) + ("\n# changed" if name == module else ""))

    yield change
    provenance.fingerprint.cache_clear()


def test_addresses_stay_when_nothing_changes(make, changed):
    before = make(["*"], chosen=["*"])
    changed("no.such.module")
    assert make(["*"], chosen=["*"]) == before


@pytest.mark.parametrize("kind", [plan.ESTIMATE, plan.TIMING])
def test_a_parameter_and_the_seed_change_the_address(make, kind):
    plain = addresses(make(["smoothed"]), kind)
    assert plain.isdisjoint(addresses(make(["smoothed[gain=0.25]"]), kind))
    assert plain.isdisjoint(addresses(make(["smoothed"], seed=2), kind))
    assert addresses(make(["smoothed[gain=0.5]"]), kind) == plain
    assert addresses(make(["smoothed"]), plan.TRUTH).isdisjoint(addresses(make(["smoothed"], seed=2), plan.TRUTH))


@pytest.mark.parametrize(
    ("module", "estimates", "truths"),
    [
        ("estimators.bootstrap", True, False),
        ("suite.resampling", True, False),
        ("suite.estimator", True, False),
        ("suite.work", True, False),
        ("suite.linalg", True, True),
        ("suite.random", True, True),
        ("suite.case", True, True),
        ("cases.linear_gaussian", True, True),
        ("estimators.kalman", False, False),
        ("estimators", False, False),
        ("cases", False, False),
        ("cases.multistatic_radar", False, False),
        ("suite.metrics.error", False, False),
        ("suite.metrics", False, False),
        ("suite.statistics", False, False),
        ("suite.store", False, False),
        ("suite.cli", False, False),
        ("reports.site", False, False),
    ],
)  # fmt: skip
def test_sources_change_the_addresses_of_what_they_produce(make, changed, module, estimates, truths):
    before = make(["bootstrap"], chosen=["linear-gaussian"])
    changed(module)
    after = make(["bootstrap"], chosen=["linear-gaussian"])
    for kind, differs in ((plan.ESTIMATE, estimates), (plan.TIMING, estimates), (plan.TRUTH, truths)):
        assert addresses(before, kind).isdisjoint(addresses(after, kind)) == differs
        assert (addresses(before, kind) == addresses(after, kind)) != differs


def test_a_data_file_changes_the_addresses_of_its_case(known, tmp_path):
    data = tmp_path / "track.csv"
    case = dataclasses.replace(known.cases["tiny"], data=(data,))
    estimators = known.estimators.select(["last"])

    def planned(text):
        data.write_text(text)
        provenance.fingerprint.cache_clear()
        return {b.address for b in plan.make(known, {case: estimators}, {case: 2}, 1, 2, []).blocks}

    assert planned("1,2") == planned("1,2")
    assert planned("1,2").isdisjoint(planned("1,3"))


def test_more_entries_change_no_address(make, tmp_path):
    more = tmp_path / "more.py"
    more.write_text("from estimators.kalman import Kalman\nclass More(Kalman):\n    name = 'more'\nESTIMATORS = (More(),)\n")
    before = make(["kalman", "last"])
    wide = catalog(ESTIMATORS, cases.MODULES).with_plugins([TINY, str(more)])
    after = plan.make(wide, {wide.cases["tiny"]: wide.estimators.select(["*"])}, {wide.cases["tiny"]: 4}, 1, 2, [])
    assert {b.address for b in before.blocks} < {b.address for b in after.blocks}
