//! What every family promises.

mod alacarte;
mod binary;
mod bits;
mod codewords;
mod film;
mod gray;
mod hilbert;
mod mps;
mod phase;
mod ramp;
mod random;
mod recommended;
mod rgb;
mod score;
mod sinusoid;
mod superposition;
mod triangle;
mod wave;
mod xor;

use nelu3d_scan::Image;
use nelu3d_scan::pattern::{
    Alacarte, Axis, Binary, Film, Gray, Hilbert, Mps, Pattern, PatternError, PatternImages, PhaseShift, Ramp, Random,
    Rgb, Sinusoid, Superposition, Triangle, Xor, generate,
};

/// The images of a family and their inverses, without names.
fn with_inverse(pattern: Pattern, width: usize, height: usize) -> Result<[Vec<Image>; 2], PatternError> {
    let PatternImages { images, inverse } = pattern.generate(width, height)?;
    Ok([images, inverse].map(|all| all.into_iter().map(|i| i.image).collect()))
}

/// The images of a family that has no inverses.
fn images(pattern: Pattern, width: usize, height: usize) -> Result<Vec<Image>, PatternError> {
    let [images, inverse] = with_inverse(pattern, width, height)?;
    assert!(inverse.is_empty());
    Ok(images)
}

/// One of each family.
fn all() -> Vec<Pattern> {
    let sinusoid = Sinusoid { axis: Axis::Y, period_px: 12.5, steps: 3 };
    let triangle = Triangle { axis: Axis::X, period_px: 20.0 };
    let random = Random { axis: Axis::X, min_period_px: 8.0, max_period_px: 40.0, seed: 3 };
    vec![
        Pattern::Sinusoid(sinusoid),
        Pattern::Triangle(triangle),
        Pattern::Ramp(Ramp { axis: Axis::X }),
        Pattern::Random(random),
        Pattern::Gray(Gray { axis: Axis::X, inverse: false }),
        Pattern::Binary(Binary { axis: Axis::Y, inverse: false }),
        Pattern::Xor(Xor { axis: Axis::X, base_px: 2, inverse: true }),
        Pattern::Phase(PhaseShift { axis: Axis::X, periods_px: vec![20.0, 50.0], steps: vec![3, 4] }),
        Pattern::Mps(Mps { frequencies: 3, ..Mps::default() }),
        Pattern::Hilbert(Hilbert { axis: Axis::X, count: 3 }),
        Pattern::Alacarte(Alacarte { max_frequency: 2.0, iterations: 3, ..Alacarte::default() }),
        Pattern::Superposition(Superposition { axis: Axis::Y, stripe_px: 3 }),
        Pattern::Film(Film::default()),
        Pattern::Rgb(Rgb {
            parts: [
                Box::new(Pattern::Triangle(triangle)),
                Box::new(Pattern::Random(random)),
                Box::new(Pattern::Ramp(Ramp { axis: Axis::Y })),
            ],
        }),
    ]
}

#[test]
fn every_family_makes_normalized_images_of_any_size() {
    for pattern in all() {
        for (w, h) in [(1, 1), (1, 9), (97, 5), (640, 3)] {
            let made = pattern.generate(w, h).unwrap();
            assert!(!made.images.is_empty(), "{pattern:?}");
            for p in &made.images {
                let i = &p.image;
                assert_eq!((i.width, i.height, i.data.len()), (w, h, w * h * i.channels), "{pattern:?}");
                assert!(i.data.iter().all(|v| (0.0..=1.0).contains(v)), "{pattern:?}");
            }
            assert_eq!(made, pattern.resolved(w, h).unwrap().generate(w, h).unwrap());
        }
        assert!(matches!(pattern.generate(0, 4), Err(PatternError::Size { .. })));
        assert!(matches!(pattern.generate(4, usize::MAX), Err(PatternError::Size { .. })));
    }
}

#[test]
fn settings_survive_a_file() {
    for pattern in all() {
        let text = toml::to_string(&pattern).unwrap();
        assert_eq!(toml::from_str::<Pattern>(&text).unwrap(), pattern, "{text}");
    }
    let wrong = "family = \"ramp\"\naxis = \"x\"\nperiod = 3";
    assert!(toml::from_str::<Pattern>(wrong).unwrap_err().to_string().contains("period"));
}

#[test]
fn names_are_numbered_through_a_set() {
    let sine = |period_px| Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px, steps: 2 });
    let set = generate(&[sine(8.0), Pattern::Ramp(Ramp::default()), sine(16.0)], 32, 2).unwrap();
    let names: Vec<_> = set.images.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["sine_00", "sine_01", "ramp_00", "sine_02", "sine_03"]);
}

#[test]
fn inverses_are_for_all_or_none() {
    let gray = Pattern::Gray(Gray { axis: Axis::X, inverse: true });
    assert_eq!(generate(&[gray, Pattern::Ramp(Ramp::default())], 8, 8), Err(PatternError::PartialInverse));
}
