//! nelu3d-field
