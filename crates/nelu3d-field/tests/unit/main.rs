//! The unit tests of the library, in files that are named after its modules. They stand outside of it because a library
//! with tests inside is compiled a second time for them, which takes two minutes here; and they are one program because
//! every program is linked on its own. What they need beyond what users do is public as well, and hidden from the
//! documentation where it would help nobody else.

mod adam;
mod bench;
mod check;
mod cost_volume;
mod device;
mod encoding;
mod field;
mod gathering;
#[cfg(feature = "gpu")]
mod gpu;
mod lattice;
mod loss;
mod memory;
mod mlp;
mod nearest;
mod normal;
mod occupancy;
mod plate;
mod state;
mod surface;
mod volrend;
