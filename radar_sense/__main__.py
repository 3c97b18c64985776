"""`python -m radar_sense` is `radar-sense`."""

from radar_sense.cli import cli

if __name__ == "__main__":
    cli()
