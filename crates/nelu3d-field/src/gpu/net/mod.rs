//! A hash grid with its network and optimizer, on the device: the part that regression and volume rendering share.
//!
//! Values of points are stored `[row][point]`, `capacity` points to a row, so that neighboring threads read neighboring
//! values.

mod descend;
mod layers;
mod layout;
mod schedule;
mod shared;
mod work;

pub(super) use layout::Net;
pub(super) use schedule::schedule;
pub(super) use shared::{Back, Shared};
