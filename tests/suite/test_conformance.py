"""The rules for estimators: each can be broken, a broken one is named alone, and `filterbench check` says so."""

import importlib.util
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from suite.conformance import CHECKS
from suite.examination import Verdict, examine, summary, title
from suite.problems import PROBLEMS
from suite.trial import RUNS, measured, numbers

PLUGINS = Path(__file__).resolve().parents[1] / "plugins"
_spec = importlib.util.spec_from_file_location("filterbench_tests_broken", PLUGINS / "broken.py")
_broken = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(_broken)
BROKEN, Sound = _broken.BROKEN, _broken.Sound
WAYS = [(rule, estimator, words) for rule, ways in BROKEN.items() for estimator, words in ways]
FIRST = [measured(PROBLEMS[0])]
ALL = [measured(case) for case in PROBLEMS]


def test_a_sound_estimator_keeps_all_rules_on_all_problems():
    verdicts = list(examine(Sound(), ALL))
    assert {v.words for v in verdicts} == {"ok"}
    assert [(v.case, v.check) for v in verdicts] == [(case.name, title(check)) for case, _ in ALL for check in CHECKS]


def test_times_of_a_case_are_cut_with_its_steps():
    irregular = replace(PROBLEMS[0], times=tuple(k**2 for k in range(1, PROBLEMS[0].steps + 1)))
    assert {v.words for v in examine(Sound(), [measured(irregular)])} == {"ok"}


@pytest.mark.parametrize(("rule", "estimator", "words"), WAYS, ids=lambda value: value if isinstance(value, str) else "")
def test_a_broken_rule_is_the_only_one_to_complain(rule, estimator, words):
    found = [v for v in examine(estimator, FIRST) if v.broken]
    assert [v.check for v in found] == [rule]
    assert words in found[0].words
    assert "\n" not in found[0].words


def test_every_rule_is_broken_by_somebody():
    assert list(BROKEN) == [title(check) for check in CHECKS]


def test_what_is_found_comes_with_the_rule():
    (found,) = [v for v in examine(BROKEN["ess"][0][0], FIRST) if v.broken]
    assert found.words == "ess is 0.5; the effective sample size lies between 1 and the number of particles"


def test_gaps_are_part_of_the_problems():
    """Estimators that stumble over a gap do so on the problem that has them, whatever else is checked there."""
    y = {case.name: y for case, y in ALL}["check/gaps"]
    patterns = {np.isnan(y[:, :, r]).tobytes() for r in range(RUNS)}
    assert len(patterns) == RUNS
    assert np.isnan(y[1]).all()
    assert np.isnan(y[:, :, 3]).all()
    assert all(np.isfinite(other).all() for case, other in ALL if case.name != "check/gaps")


@pytest.mark.parametrize("rule", ["missing component", "empty run"])
def test_runs_beside_a_gap_must_keep_their_bits(rule):
    """The first run is computed with others that have a gap, and is the same all the same."""
    mixing = _broken.broken("mixing", _broken.mix_when_odd)
    found = {v.check: v.words for v in examine(mixing, FIRST) if v.broken}
    assert "a run beside those with such measurements: mean is another" in found[rule]
    assert "a run beside those with such measurements: mean is another" in found["impossible measurements"]
    assert not {"single runs", "blocks", "one step"} & set(found)


def test_the_bearing_crosses_from_pi_to_minus_pi():
    bearing = {case.name: y for case, y in ALL}["check/angle"][:, 0]
    assert bearing.max() > 3
    assert bearing.min() < -3


def test_a_refusal_is_told_with_its_reason_and_nothing_runs():
    verdicts = list(examine(BROKEN["run"][0][0], FIRST))
    choosy = _broken.broken(
        "nothing", _broken.throw(ValueError), accepts=lambda self, model: "too\nlong" if model.n > 1 else None
    )
    verdicts = list(examine(choosy, ALL))
    refused = [v for v in verdicts if v.words == "refused: too long"]
    assert {v.case for v in refused} == {case.name for case, _ in ALL if case.model.n > 1}
    assert not any(v.broken for v in refused)
    assert {v.case for v in verdicts if v.broken} == {case.name for case, _ in ALL if case.model.n == 1}


def test_who_refuses_everything_is_not_checked_at_all():
    verdicts = list(examine(_broken.broken("nothing", accepts=lambda self, model: "never"), ALL))
    assert [v for v in verdicts if v.broken] == [
        Verdict("accepts", "", "every case on offer is refused, so nothing was run; name one that is accepted", broken=True)
    ]


def test_problems_stay_as_they_are_whatever_an_estimator_does():
    before = [numbers(case.model) for case in PROBLEMS], [y.tobytes() for _, y in ALL]
    for rule in ("accepts", "model untouched", "measurements untouched"):
        for estimator, _ in BROKEN[rule]:
            list(examine(estimator, ALL))
    after = [numbers(case.model) for case in PROBLEMS], [y.tobytes() for _, y in ALL]
    assert [{k: v for k, v in a.items() if k in b} for b, a in zip(before[0], after[0], strict=True)] == before[0]
    assert before[1] == after[1]


def test_covariances_may_be_singular_and_components_of_different_size():
    """Of rank one, with standard deviations from 1e-3 to 1e6: rounding alone makes its lowest eigenvalue negative."""
    root = np.array([1e6, 1e-3, 2.0, 0.3])
    cov = np.outer(root, root)
    assert np.linalg.eigvalsh(cov)[0] < 0

    def spoil(self, estimate, model, y, seed):
        estimate.cov[:] = cov[None, :, :, None]
        estimate.cov[0] = 0.0
        estimate.cov[1:2] = np.diag([1.0, 1.0, 1.0, -1e-19])[:, :, None]
        estimate.cov[2:3, 0, 0] *= 1 - 1e-7

    assert not any(v.broken for v in examine(_broken.broken("nothing", spoil), FIRST))


def test_a_short_case_is_long_enough():
    case, y = FIRST[0]
    for steps in (1, 2, 3):
        short = [(replace(case, steps=steps), y[:steps])]
        assert {v.words for v in examine(Sound(), short)} == {"ok"}


def test_cases_with_the_same_words_share_a_row():
    verdicts = [
        Verdict("name", "one"), Verdict("run", "one", "no", True),
        Verdict("name", "two"), Verdict("run", "two"), Verdict("ess", "two"),
        Verdict("name", "three"), Verdict("run", "three", "no", True), Verdict("name", "four", "bad", True),
    ]  # fmt: skip
    assert summary(verdicts) == [
        ("name", "one and 2 more", "ok"), ("name", "four", "bad"),
        ("run", "one and 1 more", "no"), ("run", "two", "ok"), ("ess", "two", "ok"),
    ]  # fmt: skip


# On the command line.


def words(said):
    """The output without the frames of its tables."""
    return re.sub(r"[\s│]+", " ", said.out)


def test_check_on_the_command_line(cli):
    said = cli("check", "sound", "--plugin", PLUGINS / "sound.py")
    assert (said.code, said.errors) == (0, [])
    assert "fewest particles check/linear and 10 more ok" in words(said)
    assert "1 of 1 estimators keep all rules" in said.out


def test_check_names_the_broken_rules_of_a_plugin(cli):
    said = cli("check", "Breaks*", "breaks-*", "--plugin", PLUGINS / "broken.py", "-c", "check/linear")
    assert said.code == 1
    (line,) = said.errors
    assert line.startswith("filterbench: rules are broken by Breaks_Name, breaks-reference, ")
    assert f"0 of {len(BROKEN) - 1} estimators keep all rules" in said.out
    for rule, ways in BROKEN.items():
        if rule != "parameter ranges":  # which the registry does not let in
            assert re.search(rf"{rule} check/\w+ (\w+: |[\w ]+: )?{re.escape(ways[0][1])}", words(said)), rule


def test_check_takes_patterns_parameters_and_cases(cli):
    plugins = ("--plugin", PLUGINS / "sound.py", "--plugin", PLUGINS / "tiny.py")
    said = cli("check", "so*[particles=3]", "kalman", "-c", "tiny", "check/s*", *plugins)
    assert said.code == 0
    assert "sound[particles=3]" in said.out
    assert "run tiny and 1 more ok" in words(said)
    assert "run check/scalar and 1 more refused: the model is not linear" in words(said)
    assert "run tiny and 3 more ok" in words(said)
    assert "2 of 2 estimators keep all rules" in said.out


def test_check_finds_what_a_run_puts_up_with(cli):
    """This plug-in overwrites its measurements and knows no gaps; `run` guards against the one and marks the other."""
    said = cli("check", "last", "--plugin", PLUGINS / "tiny.py", "-c", "tiny")
    assert said.code == 1
    assert "measurements untouched tiny run wrote to the measurements; " in words(said)
    assert "empty step tiny run 1, step 3: mean is not finite; " in words(said)


def test_a_warning_is_not_silence(shell, tmp_path):
    """On a terminal it would stand among the rows of the table."""
    text = (PLUGINS / "sound.py").read_text().replace('"""Nothing here."""', 'import warnings\n        warnings.warn("odd")')
    (tmp_path / "warns.py").write_text(text)
    said = shell("check", "sound", "--plugin", tmp_path / "warns.py", "-c", "check/linear", cwd=tmp_path)
    assert said.code == 1
    assert said.errors == ["filterbench: rules are broken by sound"]
    assert re.search(r"silence check/linear run wrote '\S+warns.py:\d+: UserWarning: odd", words(said))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["kalmann"], "no estimator matches 'kalmann'; did you mean 'kalman'?"),
        (["kalman[gain=1]"], "kalman has no parameter 'gain'; it has no parameters"),
        (["kalman", "-c", "liner"], "no case matches 'liner'; did you mean 'jump-linear' or 'check/linear' or"),
        (["kalman", "-c", "check/angel"], "no case matches 'check/angel'; did you mean 'check/angle'"),
        (["kalman", "--plugin", "none.py"], "plug-in none.py is no file"),
        (["kalman", "--plugin", str(PLUGINS / "faulty_cases.py"), "-c", "short"], "case short does not simulate: ValueError:"),
        (["kalman", "--jobs", "2"], "unrecognized arguments: --jobs 2"),
    ],
    ids=lambda value: " ".join(value)[:30] if isinstance(value, list) else "",
)  # fmt: skip
def test_a_mistake_gives_one_line(cli, arguments, message):
    said = cli("check", *arguments)
    assert (said.code, len(said.errors)) == (2, 1)
    assert said.errors[0].startswith("filterbench: ")
    assert message in said.errors[0]
    assert not said.out
