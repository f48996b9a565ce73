//! Board poses from corners: PnP with refinement, and the trajectory of a sweep.
