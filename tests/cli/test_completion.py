"""Completion of commands, of options, and of the values of options."""

import shlex
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete, get_completion_class

from radar_sense.cli import cli
from radar_sense.propagation import METHODS
from radar_sense.reading.parse import load_scenario

ROOT = Path(__file__).parents[2]
NETWORK = str(ROOT / "configs/network.yaml")
LEVELS = list(load_scenario(NETWORK).cov_radar)
USUAL = ["low", "medium", "high"]


def completed(*words):
    """Return the completions of the last word."""
    *before, last = words
    shell = ShellComplete(cli, {}, "radar-sense", "_RADAR_SENSE_COMPLETE")
    return [item.value for item in shell.get_completions(before, last)]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["va"], ["validate", "variance"]),
        (["budget", "--meth"], ["--method"]),
        (["variance", "--method", ""], [*METHODS, "automatic"]),
        (["variance", "--method", "p"], ["probit"]),
        (["variance", "--method=p"], ["probit"]),
        (["budget", "--method", "m"], ["montecarlo"]),
        (["mission", "--method", ""], ["importance", "linear", "probit"]),
        (["montecarlo", "--sampler", ""], ["random", "sobol"]),
        (["montecarlo", "--format", "p"], ["png", "pdf"]),
        (["variance", "--level", ""], USUAL),
        (["variance", NETWORK, "--level", ""], LEVELS),
        (["variance", NETWORK, "--method", "form", "--level", "h"], ["high"]),
        (["variance", "--method", "form", NETWORK, "--level", "h"], ["high"]),
        (["variance", "--radar", ""], []),
        (["variance", NETWORK, "--radar", ""], ["search", "ridge", "mobile"]),
        (["variance", NETWORK, "--radar", "r"], ["ridge"]),
        (["variance", NETWORK, "--level", "high", "--radar=mo"], ["mobile"]),
        (["variance", "missing.yaml", "--level", ""], []),
        (["variance", "--threshold", ""], []),
        (["init", "--r"], ["--route"]),
    ],
)
def test_completions(words, expected):
    assert completed(*words) == expected


def test_a_new_method_is_completed(monkeypatch):
    monkeypatch.setitem(METHODS, "wide", METHODS["linear"])
    assert completed("variance", "--method", "w") == ["wide"]


@pytest.mark.parametrize(
    ("shell", "answer"),
    [("bash", "plain,ridge"), ("zsh", "plain\nridge\n_"), ("fish", "plain,ridge")],
)
def test_shells(shell, answer, monkeypatch):
    """Each shell gets a completion script, and the words in its own format."""
    completion = get_completion_class(shell)(cli, {}, "radar-sense", "_RADAR_SENSE_COMPLETE")
    words = ["radar-sense", "variance", NETWORK, "--radar", "r"]
    monkeypatch.setenv("COMP_WORDS", shlex.join(words))
    monkeypatch.setenv("COMP_CWORD", "r" if shell == "fish" else "4")
    assert completion.complete().strip() == answer
    if shell != "bash":  # the script for bash looks at the version of bash
        assert f"_RADAR_SENSE_COMPLETE={shell}_complete" in completion.source()
