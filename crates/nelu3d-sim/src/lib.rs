//! nelu3d-sim
