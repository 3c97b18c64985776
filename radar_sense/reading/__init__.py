"""Files to a `Scenario`; the only place that knows YAML, CSV, degrees and decibels."""
