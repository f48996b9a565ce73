use nelu3d_scan::pattern::{Axis, Codewords, Film, Pattern};

use super::images;

#[test]
fn transmittances_lie_between_the_densities_and_no_two_places_are_alike() {
    let film = Film { min_density: 0.1, max_density: 1.0, ..Film::default() };
    let images = images(Pattern::Film(film), 900, 2).unwrap();
    assert_eq!((images.len(), images[0].channels), (1, 3));
    let density = |v: f32| -f64::from(v).log10();
    assert!(images[0].data.iter().all(|&v| (0.1 - 1e-6..=1.0 + 1e-6).contains(&density(v))));
    let words = Codewords::of_images(&images, Axis::X);
    for u in 0..900 {
        assert_eq!(words.nearest(words.word(u)).unwrap().0, u);
    }
}

#[test]
fn impossible_films_are_refused() {
    for film in [
        Film { fine_px: 0.0, ..Film::default() },
        Film { min_density: -1.0, ..Film::default() },
        Film { max_density: 0.01, ..Film::default() },
        Film { max_density: f64::NAN, ..Film::default() },
    ] {
        assert!(images(Pattern::Film(film), 64, 2).is_err(), "{film:?}");
    }
}
