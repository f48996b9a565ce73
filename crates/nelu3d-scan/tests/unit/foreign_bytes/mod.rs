//! Properties of everything that reads bytes of other programs: whatever they are, a reader answers soon, without a
//! panic and without asking for more memory than a file of that size can justify; and what is written is read back as
//! it was.

mod images;
mod meshes;
mod mutation;
mod numbers;
mod rigs;
// The test `fuzz` of nelu3d-cli shares it.
mod watched;

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use rand::SeedableRng;
use rand::rngs::StdRng;

use self::watched::{measured, watched};

/// Tries so many random cases, times the number in `NELU3D_MORE_CASES` for a long search. What a case is made from is
/// seeded by its number, which the message of a failure begins with.
fn cases(n: u64, test: impl Fn(&mut StdRng)) {
    let factor = std::env::var("NELU3D_MORE_CASES").ok().and_then(|f| f.parse().ok()).unwrap_or(1);
    for case in 0..n.saturating_mul(factor) {
        let mut rng = StdRng::seed_from_u64(case);
        // Readers that panic fail a test as its own assertions do.
        if let Err(e) = catch_unwind(AssertUnwindSafe(|| test(&mut rng))) {
            panic!("case {case} (StdRng::seed_from_u64({case})): {}", message(&*e));
        }
    }
}

/// The message of a panic.
fn message(panic: &(dyn Any + Send)) -> &str {
    match panic.downcast_ref::<String>() {
        Some(text) => text,
        None => panic.downcast_ref::<&str>().copied().unwrap_or("a panic without a message"),
    }
}

#[test]
fn the_case_that_fails_is_named() {
    let three = AssertUnwindSafe(|| cases(9, |rng| assert!(*rng != StdRng::seed_from_u64(3), "it is the one")));
    let e = catch_unwind(three).unwrap_err();
    assert_eq!(message(&*e), "case 3 (StdRng::seed_from_u64(3)): it is the one");
}
