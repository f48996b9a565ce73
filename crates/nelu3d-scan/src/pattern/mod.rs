//! Projected patterns.
