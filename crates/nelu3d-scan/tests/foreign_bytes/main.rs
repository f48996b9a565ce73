//! Properties of everything that reads bytes of other programs: whatever they are, a reader answers soon, without a
//! panic and without asking for more memory than a file of that size can justify; and what is written is read back as
//! it was.

#[path = "../../src/import/tests/dng.rs"]
mod dng;
mod images;
mod meshes;
mod mutation;
mod numbers;
mod rigs;
mod watched;

use proptest::test_runner::Config;

use self::watched::{measured, watched};

/// So many cases, times the number in `NELU3D_MORE_CASES` for a long search, and no file of failed ones: CI's checkout
/// is thrown away.
fn cases(n: u32) -> Config {
    let factor = std::env::var("NELU3D_MORE_CASES").ok().and_then(|f| f.parse().ok()).unwrap_or(1u32);
    Config { failure_persistence: None, ..Config::with_cases(n.saturating_mul(factor)) }
}
