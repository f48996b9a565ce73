//! The unit tests of the library, in files that are named after its modules: as a part of it, they would have all of it
//! compiled once more.

mod cad;
mod comparison;
mod evaluation;
mod ground_truth;
mod jumps;
mod trace;
