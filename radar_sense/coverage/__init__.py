"""P_D over an area: in the cells of a map, and along rays from a radar."""
