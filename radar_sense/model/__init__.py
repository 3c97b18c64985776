"""Physics over arrays: geometry, cross section, radar equation, detection and their gradients."""
