//! Random numbers by their coordinates: every row of every image has a generator of its own, seeded by what it is for.
//! So the order in which threads come to them does not matter, and one image's noise does not depend on whether another
//! is made.

use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;

/// The purpose of random numbers. It keeps equal coordinates of different uses apart.
#[derive(Clone, Copy, Debug)]
pub enum RandomPurpose {
    /// Poses of the board, and the hands that hold it.
    Sweep = 1,
    /// Where rays pass through pixels, and where light goes from surface to surface.
    Pixels = 2,
    /// The noise of the sensor.
    Sensor = 3,
    /// The pattern on a film.
    Film = 4,
}

/// Returns a hash of the seed, the purpose and three coordinates, by SplitMix64's finalizer (Steele, Lea and Flood,
/// OOPSLA 2014).
pub(crate) fn hash(seed: u64, purpose: RandomPurpose, coordinates: [u64; 3]) -> u64 {
    let mut h = mix(seed ^ 0x6e65_6c75_3364);
    for v in [purpose as u64, coordinates[0], coordinates[1], coordinates[2]] {
        h = mix(h ^ v);
    }
    h
}

/// Returns the generator of a seed, a purpose and three coordinates: of equal ones always the same.
pub fn generator(seed: u64, purpose: RandomPurpose, coordinates: [u64; 3]) -> Xoshiro256PlusPlus {
    Xoshiro256PlusPlus::seed_from_u64(hash(seed, purpose, coordinates))
}

/// Returns the next of SplitMix64's numbers.
pub(crate) fn mix(x: u64) -> u64 {
    let mut z = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
