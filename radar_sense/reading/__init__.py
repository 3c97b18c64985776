"""From files to a `Scenario`: YAML, CSV, degrees and decibels to SI units."""
