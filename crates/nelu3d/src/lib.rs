//! nelu3d
