//! The unit tests of the library, in files that are named after its modules. They stand outside of it because a library
//! with tests inside is compiled a second time for them; and they are one program because every program is linked on
//! its own. What they need beyond what users do is public as well, in modules that the documentation does not show.

mod calibrate;
mod color_field;
mod drift;
mod from_projector;
mod progress;
mod reconstruct;
mod result;
mod sensor;
mod sequence;
mod surface;
mod verdict;
