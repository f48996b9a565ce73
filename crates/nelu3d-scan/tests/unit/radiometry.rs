//! Cameras of known response look at a scene of known light.

use nelu3d_scan::image::{Raw, RawData, Response};
use nelu3d_scan::pattern::{Pattern, Superposition};
use nelu3d_scan::radiometry::{LightRelation, ResponseError, ResponseEstimator, ResponseReport};

const SIZE: [usize; 2] = [200, 150];

/// A camera's code of light.
type Curve = fn(f64) -> f64;

/// A camera before stripes on a surface that gets darker from left to right, with a dark half.
struct Scene {
    /// Codes of light, both of full scale.
    camera: fn(f64) -> f64,
    /// Light of the projector's codes.
    projector: fn(f64) -> f64,
    /// Light of the brightest surface.
    brightest: f64,
    /// Width of a stripe, px of the camera.
    stripe_px: u32,
    /// Pixels to each side over which the camera's picture is blurred: at 0 each stripe is seen alone.
    blur: usize,
    /// Light that comes from elsewhere.
    ambient: f64,
    /// Standard deviation of the light, and of each image's brightness.
    noise: [f64; 2],
}

const STILL: Scene = Scene {
    camera: |light| light,
    projector: |code| code.powf(2.2),
    brightest: 0.9,
    stripe_px: 6,
    blur: 4,
    ambient: 0.01,
    noise: [0.002, 0.0],
};

/// A pseudorandom number that is about normal.
fn normal(state: &mut u64) -> f64 {
    let mut uniform = || {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 33) as f64 / (1u64 << 31) as f64
    };
    (0..12).map(|_| uniform()).sum::<f64>() - 6.0
}

impl Scene {
    /// Takes an image of light, in units of the brightest surface's.
    fn take(&self, shown: impl Fn(usize, usize) -> f64, exposure: f64, seed: u64) -> Raw {
        let ([w, h], mut state) = (SIZE, 0x9e37_79b9 ^ (seed << 8));
        let gain = exposure * (1.0 + self.noise[1] * normal(&mut state));
        let mut codes = Vec::with_capacity(w * h);
        for y in 0..h {
            for x in 0..w {
                let surface = (1.0 - 0.6 * x as f64 / w as f64) * if y > h / 2 { 0.15 } else { 1.0 };
                let light = gain * self.brightest * surface * (shown(x, y) + self.ambient);
                let light = light + self.noise[0] * normal(&mut state);
                codes.push((255.0 * (self.camera)(light.clamp(0.0, 1.0))).round() as u8);
            }
        }
        Raw { width: w, height: h, channels: 1, data: RawData::U8(codes) }
    }

    /// The images of [`Superposition`], then black.
    fn superposed(&self) -> Vec<Raw> {
        let made = Pattern::Superposition(Superposition { stripe_px: self.stripe_px, ..Superposition::default() });
        let made = made.generate(SIZE[0], 1).unwrap();
        let light = |image: usize, x: usize| (self.projector)(f64::from(made.images[image].image.data[x]));
        let seen = |image: usize, x: usize| {
            let around = (x.saturating_sub(self.blur)..=(x + self.blur).min(SIZE[0] - 1)).map(|x| light(image, x));
            around.clone().sum::<f64>() / around.count() as f64
        };
        let mut all: Vec<Raw> =
            (0..Superposition::IMAGES).map(|i| self.take(|x, _| seen(i, x), 1.0, i as u64)).collect();
        all.push(self.take(|_, _| 0.0, 1.0, 99));
        all
    }

    fn measure(&self) -> Result<(Response, ResponseReport), ResponseError> {
        let mut estimator = ResponseEstimator::new(0.0, 255.0);
        let images = self.superposed();
        estimator.add(&images.iter().collect::<Vec<_>>(), &LightRelation::superposition(Superposition::IMAGES))?;
        estimator.finish("response.json")
    }

    /// Largest error of a measured response over the codes that were seen, of its height there.
    fn error(&self, response: &Response, report: &ResponseReport) -> f64 {
        let [low, high] = report.range;
        // The light of a code, by bisection.
        let truth = |code: f64| {
            let (mut a, mut b) = (0.0, 1.0);
            for _ in 0..60 {
                let m = 0.5 * (a + b);
                if (self.camera)(m) < code { a = m } else { b = m }
            }
            a
        };
        let fixed = |f: &dyn Fn(f64) -> f64, c: f64| (f(c) - f(low)) / (f(high) - f(low));
        let codes = (0..=100).map(|i| low + (high - low) * f64::from(i) / 100.0);
        codes.map(|c| (fixed(&|c| response.light(c), c) - fixed(&truth, c)).abs()).fold(0.0, f64::max)
    }
}

fn srgb(light: f64) -> f64 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// A phone's: sRGB with a shoulder and a foot.
fn toned(light: f64) -> f64 {
    let v = srgb(light);
    v + 0.35 * v * (1.0 - v) * (v - 0.35)
}

#[test]
fn responses_are_found_whether_stripes_are_resolved_or_not() {
    // Stripes that stand out, and stripes that are one gray.
    for stripe_px in [6, 1] {
        let cameras: [(&str, Curve); 3] =
            [("gamma", |light| light.powf(1.0 / 2.2)), ("toned", toned), ("root", f64::sqrt)];
        for (name, camera) in cameras {
            let scene = Scene { camera, stripe_px, ..STILL };
            let (response, report) = scene.measure().unwrap();
            assert!(
                matches!(&response, Response::Table { file, .. } if file == "response.json"),
                "{name}: {response:?}"
            );
            let error = scene.error(&response, &report);
            println!("{name}, {stripe_px} px: {:.3} of {:.3} %", 100.0 * error, report.standard_error_percent);
            assert!(error < 0.006, "{name}, {stripe_px} px: {error}, {report:?}");
            assert!(error < 4.0 * report.standard_error_percent / 100.0 + 0.002, "{name}: {error}, {report:?}");
            // What rig.toml names must be read again.
            let Response::Table { code, light, .. } = &response else { panic!("a table") };
            let json = serde_json::json!({ "code": code, "light": light }).to_string();
            assert_eq!(Response::from_json("response.json", json.as_bytes()).unwrap(), response);
        }
        let cameras: [(Curve, Response); 2] = [(|light| light, Response::Linear), (srgb, Response::Srgb)];
        for (camera, expected) in cameras {
            let (response, report) = Scene { camera, stripe_px, ..STILL }.measure().unwrap();
            assert_eq!(response, expected, "{report:?}");
        }
    }
}

#[test]
fn a_lamp_that_flickers_widens_the_stated_error() {
    let steady = Scene { camera: srgb, ..STILL };
    let flickers = Scene { noise: [0.002, 0.01], ..steady };
    let (_, a) = steady.measure().unwrap();
    match flickers.measure() {
        Ok((response, b)) => {
            assert!(b.standard_error_percent > 2.0 * a.standard_error_percent, "{a:?} {b:?}");
            println!("flicker: {} of {} %", 100.0 * flickers.error(&response, &b), b.standard_error_percent);
            let error = flickers.error(&response, &b);
            assert!(error < 4.0 * b.standard_error_percent / 100.0, "{error}: {b:?}");
        }
        Err(e) => assert!(matches!(e, ResponseError::Undetermined { .. }), "{e}"),
    }
}

#[test]
fn exposures_show_the_response() {
    let scene = Scene { camera: toned, ambient: 0.2, ..STILL };
    let secs = [0.02, 0.04, 0.08, 0.16];
    let images: Vec<Raw> = secs.iter().enumerate().map(|(i, s)| scene.take(|_, _| 1.0, s / 0.1, i as u64)).collect();
    let mut estimator = ResponseEstimator::new(0.0, 255.0);
    estimator.add(&images.iter().collect::<Vec<_>>(), &LightRelation::exposure_series(&secs)).unwrap();
    let (response, report) = estimator.finish("r.json").unwrap();
    let error = scene.error(&response, &report);
    assert!(error < 0.01, "{error}: {report:?}");
}

#[test]
fn what_does_not_determine_the_response_is_refused() {
    // Exposures that follow the picture.
    let scene = Scene { camera: srgb, ..STILL };
    let mut images = scene.superposed();
    for (i, image) in images.iter_mut().enumerate() {
        let RawData::U8(codes) = &mut image.data else { panic!("8 bits") };
        let mean = codes.iter().map(|c| f64::from(*c)).sum::<f64>() / codes.len() as f64;
        if i < Superposition::IMAGES {
            codes.iter_mut().for_each(|c| *c = (f64::from(*c) * 70.0 / mean).round().min(255.0) as u8);
        }
    }
    let mut estimator = ResponseEstimator::new(0.0, 255.0);
    let relations = LightRelation::superposition(Superposition::IMAGES);
    estimator.add(&images.iter().collect::<Vec<_>>(), &relations).unwrap();
    let e = estimator.finish("r.json").unwrap_err();
    assert!(matches!(e, ResponseError::DoesNotAddUp { .. } | ResponseError::Undetermined { .. }), "{e}");
    // Too dark, every stripe seen alone, unlit, clipped.
    let dark = Scene { brightest: 0.2, ..STILL }.measure().unwrap_err();
    assert!(matches!(dark, ResponseError::TooDark { .. }), "{dark}");
    let sharp = Scene { blur: 0, ..STILL };
    for scene in [sharp, Scene { projector: |_| 0.0, ..STILL }, Scene { brightest: 1e5, ..STILL }] {
        let e = scene.measure().unwrap_err();
        assert!(matches!(e, ResponseError::TooLittle { .. }), "{e}");
    }
    // Another camera's.
    let other = Raw { width: 3, height: 2, channels: 1, data: RawData::U8(vec![0; 6]) };
    let e = ResponseEstimator::new(0.0, 255.0).add(&[&images[0], &other], &[]).unwrap_err();
    assert!(e.to_string().contains("200 x 150"), "{e}");
}
