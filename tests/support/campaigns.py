"""A short campaign of an unknown wall."""

from uvms_drake.command.main import main

RUNS = 3
SHORT = ["campaign", "girona500_contact", "--uncertified", "--set", "duration=0.6", "--seed", "3"]


def refusal(capsys, *args: str) -> str:
    """Runs with bad input and returns the only line on stderr."""
    assert main([*SHORT, *args]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err
