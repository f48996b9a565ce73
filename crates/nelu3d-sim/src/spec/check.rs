//! Whether a spec makes sense.

use std::collections::HashSet;
use std::io;
use std::path::PathBuf;

use nelu3d_scan::image::ImageFileError;
use nelu3d_scan::mesh::MeshFileError;
use nelu3d_scan::pattern::{self, Pattern, PatternError};
use nelu3d_scan::rig::Channels;

use super::{
    AlbedoSpec, AxisSpec, BoardSpec, DeformationSpec, LightSpec, MaterialSpec, ObjectSpec, PerColor, SequenceSpec,
    ShapeSpec, Spec, SweepSpec,
};
use crate::scene::check_files;
use crate::scene::shape::Vase;

/// Why a spec cannot be simulated.
#[derive(Debug, thiserror::Error)]
pub enum SpecError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Something in a file.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: Box<SpecError>,
    },
    /// Not TOML, an unknown key, or a value of another type.
    #[error("{reason}")]
    Syntax {
        /// What the parser said, with the line.
        reason: String,
    },
    /// A value that makes no sense.
    #[error("`{key}` is {value}; {remedy}")]
    Value {
        /// The key.
        key: String,
        /// Its value.
        value: String,
        /// What it must be.
        remedy: String,
    },
    /// A mesh that cannot be read.
    #[error("`{key}`: {source}")]
    Mesh {
        /// The key.
        key: String,
        /// What is wrong with the file.
        source: MeshFileError,
    },
    /// A picture that cannot be read.
    #[error("`{key}`: {source}")]
    Image {
        /// The key.
        key: String,
        /// What is wrong with the file.
        source: ImageFileError,
    },
    /// A pattern that cannot be made.
    #[error("pattern set `{set}`: {source}")]
    Pattern {
        /// Its set.
        set: String,
        /// What is wrong with it.
        source: PatternError,
    },
}

/// Longest side of an image, px.
const MAX_SIDE_PX: usize = 32_768;

fn check(good: bool, key: impl Into<String>, value: impl ToString, remedy: &str) -> Result<(), SpecError> {
    if good {
        return Ok(());
    }
    Err(SpecError::Value { key: key.into(), value: value.to_string(), remedy: remedy.into() })
}

/// Every length and angle stays far from where `f64` arithmetic on it would overflow.
fn finite(key: &str, values: &[f64]) -> Result<(), SpecError> {
    let good = values.iter().all(|v| v.abs() < 1e7);
    check(good, key, format!("{values:?}"), "give finite numbers below ten million")
}

fn positive(key: &str, value: f64) -> Result<(), SpecError> {
    check(value > 0.0 && value < 1e9, key, value, "give a number above 0")
}

fn within(key: &str, value: f64, low: f64, high: f64) -> Result<(), SpecError> {
    check((low..=high).contains(&value), key, value, &format!("give {low} to {high}"))
}

fn name(key: &str, name: &str, taken: &mut HashSet<String>) -> Result<(), SpecError> {
    let plain = !name.is_empty()
        && !name.starts_with('.')
        && name.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.'));
    check(plain, key, format!("\"{name}\""), "use letters, digits, `-` and `_`: it becomes a file name")?;
    check(taken.insert(name.to_owned()), key, format!("\"{name}\""), "it is used twice; give each its own")
}

struct Optics<'a> {
    key: &'a str,
    size: [usize; 2],
    intrinsics: [f64; 4],
    distortion: bool,
}

fn optics(o: &Optics) -> Result<(), SpecError> {
    for (side, n) in ["width", "height"].iter().zip(o.size) {
        check((1..=MAX_SIDE_PX).contains(&n), format!("{}.{side}", o.key), n, "give 1 to 32768 px")?;
    }
    let [fx, fy, cx, cy] = o.intrinsics;
    positive(&format!("{}.fx", o.key), fx)?;
    positive(&format!("{}.fy", o.key), fy)?;
    finite(&format!("{}.cx, cy", o.key), &[cx, cy])?;
    let key = format!("{}.distortion", o.key);
    check(o.distortion, key, "no list OpenCV knows", "give 0, 4, 5, 8, 12 or 14 finite coefficients")
}

fn aim(key: &str, position: [f64; 3], target: [f64; 3]) -> Result<(), SpecError> {
    finite(&format!("{key}.position_mm"), &position)?;
    finite(&format!("{key}.target_mm"), &target)?;
    let [x, y, z] = [0, 1, 2].map(|i| target[i] - position[i]);
    // Straight up or down there is no level direction to align its rows with.
    let good = (x * x + z * z).sqrt() > 1e-3 * (x * x + y * y + z * z).sqrt() + 1e-9;
    let remedy = "it must differ from position_mm, and not only in y";
    check(good, format!("{key}.target_mm"), format!("{target:?}"), remedy)
}

impl Spec {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// The first value that makes no sense, with its key and a remedy.
    pub fn check(&self) -> Result<(), SpecError> {
        within("supersampling", self.supersampling as f64, 1.0, 16.0)?;
        within("ambient", self.ambient, 0.0, 1e3)?;
        within("interreflection.bounces", self.interreflection.bounces as f64, 0.0, 64.0)?;
        within("interreflection.paths_per_pixel", self.interreflection.paths_per_pixel as f64, 1.0, 1e5)?;
        self.check_camera()?;
        self.check_light()?;
        self.check_board_and_sweep()?;
        let mut names = HashSet::new();
        for scene in &self.scenes {
            name("scenes.name", &scene.name, &mut names)?;
            for object in &scene.objects {
                check_object(&format!("scenes `{}`", scene.name), object)?;
            }
        }
        names.clear();
        for sequence in &self.sequences {
            name("sequences.name", &sequence.name, &mut names)?;
            self.check_sequence(sequence)?;
        }
        Ok(())
    }

    fn check_camera(&self) -> Result<(), SpecError> {
        let c = &self.camera;
        let intrinsics = [c.fx, c.fy, c.cx, c.cy];
        let distortion = c.optics().is_some();
        optics(&Optics { key: "camera", size: [c.width, c.height], intrinsics, distortion })?;
        let known = Channels::ALL.map(Channels::name).join(", ");
        check(c.channels().is_some(), "camera.channels", &c.channels, &format!("it must be one of: {known}"))?;
        within("camera.bits", f64::from(c.bits), 1.0, 16.0)?;
        let good = c.black_level >= 0.0 && c.black_level < c.saturation();
        check(good, "camera.black_level", c.black_level, "it must be 0 or more, and below the largest code")?;
        within("camera.full_well_electrons", c.full_well_electrons, 1.0, 1e9)?;
        within("camera.read_noise_electrons", c.read_noise_electrons, 0.0, 1e6)?;
        within("camera.psf_sigma_px", c.psf_sigma_px, 0.0, 20.0)?;
        within("camera.gain", c.gain, 1.0, 1e4)?;
        let rates = c.electrons_per_sec;
        for rate in rates.rgb() {
            let good = rate > 0.0 && rate <= 1e15;
            check(good, "camera.electrons_per_sec", rate, "give a number above 0, up to 1e15")?;
        }
        let one = matches!(rates, PerColor::Same(_)) || c.channels() != Some(Channels::Mono);
        check(
            one,
            "camera.electrons_per_sec",
            format!("{:?}", rates.rgb()),
            "a mono camera has one channel: give one number",
        )?;
        let good = c.exposure_secs > 0.0 && c.exposure_secs <= 3600.0;
        check(good, "camera.exposure_secs", c.exposure_secs, "give seconds above 0, up to 3600")?;
        within("camera.dark_electrons_per_sec", c.dark_electrons_per_sec, 0.0, 1e9)?;
        within("camera.shutter_samples", c.shutter_samples as f64, 1.0, 64.0)?;
        within("camera.vignetting", c.vignetting, 0.0, 100.0)?;
        check(
            c.mono_images.is_empty() || c.channels() == Some(Channels::Rgb),
            "camera.mono_images",
            c.mono_images.join(", "),
            "only a camera with channels = \"rgb\" has another mode for them",
        )?;
        finite("camera.color_mixing", c.color_mixing.as_flattened())
    }

    fn check_sequence(&self, s: &SequenceSpec) -> Result<(), SpecError> {
        let key = |field: &str| format!("sequences `{}`: {field}", s.name);
        check(s.fps > 0.0 && s.fps <= 1e7, key("fps"), s.fps, "give a number above 0, up to ten million")?;
        within(&key("frames"), s.frames as f64, 1.0, 100_000.0)?;
        within(&key("flash_delay_secs"), s.flash_delay_secs, -3600.0, 3600.0)?;
        within(&key("pattern_interval_secs"), s.pattern_interval_secs, 0.0, 3600.0)?;
        if let Some(set) = &s.pattern_set {
            let known = match &self.light {
                LightSpec::Projector(_) => self.pattern_sets.iter().any(|p| p.name == *set),
                LightSpec::Film(_) => false,
            };
            check(known, key("pattern_set"), format!("\"{set}\""), "give a name from pattern_sets, or leave it out")?;
        }
        for moving in &s.objects {
            check_object(&format!("sequences `{}`", s.name), &moving.object)?;
            let m = &moving.motion;
            finite(&key("objects.motion.velocity_mm_per_sec"), &m.velocity_mm_per_sec)?;
            finite(&key("objects.motion.acceleration_mm_per_sec2"), &m.acceleration_mm_per_sec2)?;
            finite(&key("objects.motion.angular_velocity"), &m.angular_velocity)?;
            finite(&key("objects.motion.vibration_hz, phase_per_sec"), &[m.vibration_hz, m.phase_per_sec])?;
        }
        Ok(())
    }

    fn check_light(&self) -> Result<(), SpecError> {
        let color = self.camera.channels().is_some_and(|c| c != Channels::Mono);
        match &self.light {
            LightSpec::Projector(p) => {
                let intrinsics = [p.fx, p.fy, p.cx, p.cy];
                let distortion = p.optics().is_some();
                optics(&Optics { key: "light", size: [p.width, p.height], intrinsics, distortion })?;
                aim("light", p.position_mm, p.target_mm)?;
                positive("light.reference_mm", p.reference_mm)?;
                positive("light.focus_mm", p.focus_mm)?;
                within("light.sharp_sigma_px", p.sharp_sigma_px, 0.0, 50.0)?;
                within("light.aperture_mm", p.aperture_mm, 0.0, 1e3)?;
                within("light.vignetting", p.vignetting, 0.0, 100.0)?;
                within("light.black_leak", p.black_leak, 0.0, 0.99)?;
                for gamma in p.gamma.rgb() {
                    within("light.gamma", gamma, 0.1, 10.0)?;
                }
                let good = p.fill_factor > 0.0 && p.fill_factor <= 1.0;
                check(good, "light.fill_factor", p.fill_factor, "give a number above 0, up to 1")?;
                finite("light.roll", &[p.roll])?;
                for tilt in p.focus_tilt {
                    within("light.focus_tilt", tilt, -1.5, 1.5)?;
                }
                for v in p.primaries.as_flattened() {
                    within("light.primaries", *v, 0.0, 1e3)?;
                }
                check(!self.pattern_sets.is_empty(), "pattern_sets", "empty", "give a projector a pattern to show")?;
                let mut names = HashSet::new();
                for set in &self.pattern_sets {
                    name("pattern_sets.name", &set.name, &mut names)?;
                    // One row tells all about the settings, at no cost.
                    let made = pattern::generate(&set.patterns, p.width, 1)
                        .map_err(|source| SpecError::Pattern { set: set.name.clone(), source })?;
                    check(!made.images.is_empty(), "pattern_sets.patterns", "empty", "give the set a pattern")?;
                    let rgb = set.patterns.iter().any(Pattern::is_color);
                    check(
                        color || !rgb,
                        "pattern_sets.patterns",
                        "rgb",
                        "a mono camera cannot tell its channels apart",
                    )?;
                }
            }
            LightSpec::Film(f) => {
                let none = self.pattern_sets.is_empty();
                check(none, "pattern_sets", "not empty", "film has its own pattern; leave them out")?;
                check(color, "camera.channels", &self.camera.channels, "film is colored: give it a color camera")?;
                aim("light", f.position_mm, f.target_mm)?;
                finite("light.flash_offset_mm", &f.flash_offset_mm)?;
                positive("light.reference_mm", f.reference_mm)?;
                for v in f.film_led.iter().chain(&f.flash_led) {
                    let good = *v > 0.0 && *v <= 1e3;
                    check(good, "light.film_led, flash_led", v, "give numbers above 0, up to 1000")?;
                }
                positive("light.film_mm", f.film_mm)?;
                within("light.lamp_sigma_mm", f.lamp_sigma_mm, 0.0, 1e3)?;
                positive("light.film_half_size_mm", f.film_half_size_mm[0].min(f.film_half_size_mm[1]))?;
                within("light.vignetting", f.vignetting, 0.0, 100.0)?;
                within("light.spread", f.spread, 0.0, std::f64::consts::PI)?;
                within("light.waves", f.waves as f64, 1.0, 64.0)?;
                positive("light.min_period_mm", f.min_period_mm)?;
                let good = f.max_period_mm >= f.min_period_mm && f.max_period_mm < 1e9;
                check(good, "light.max_period_mm", f.max_period_mm, "it must not be below min_period_mm")?;
            }
        }
        Ok(())
    }

    fn check_board_and_sweep(&self) -> Result<(), SpecError> {
        let board = self.board.board();
        let [x0, y0, x1, y1] = board.extent_mm;
        finite("board.extent_mm", &board.extent_mm)?;
        for albedo in self.board_albedo {
            within("board_albedo", albedo, 0.0, 1.0)?;
        }
        let shown = format!("{:?}", board.extent_mm);
        check(x0 < x1 && y0 < y1, "board.extent_mm", shown, "it must be [x_min, y_min, x_max, y_max]")?;
        if let BoardSpec::Charuco { columns, rows, square_mm, .. }
        | BoardSpec::Chessboard { columns, rows, square_mm, .. } = &self.board
        {
            check((3..=1000).contains(columns), "board.columns", columns, "give 3 to 1000 squares")?;
            check((3..=1000).contains(rows), "board.rows", rows, "give 3 to 1000 squares")?;
            positive("board.square_mm", *square_mm)?;
        }
        if let Some(dpi) = self.print_dpi {
            within("print_dpi", dpi, 1.0, 100_000.0)?;
        }
        within("sweep.positions", self.sweep.positions() as f64, 3.0, 100_000.0)?;
        let (SweepSpec::Stage { first_mm, last_mm, center_mm, .. }
        | SweepSpec::Handheld { first_mm, last_mm, center_mm, .. }) = &self.sweep;
        positive("sweep.first_mm", *first_mm)?;
        positive("sweep.last_mm", *last_mm)?;
        finite("sweep.center_mm", center_mm)?;
        match &self.sweep {
            SweepSpec::Stage { slope, rotation, step_error_mm, tilt_jitter, .. } => {
                within("sweep.tilt_jitter", *tilt_jitter, 0.0, 1.0)?;
                finite("sweep.slope", slope)?;
                finite("sweep.rotation", rotation)?;
                within("sweep.step_error_mm", *step_error_mm, 0.0, 1e3)
            }
            SweepSpec::Handheld { position_sigma_mm, tilt_sigma, .. } => {
                within("sweep.position_sigma_mm", *position_sigma_mm, 0.0, 1e3)?;
                within("sweep.tilt_sigma", *tilt_sigma, 0.0, 1.0)
            }
        }
    }
}

/// An object of the scene or sequence `place`; also reads the files it names.
pub(super) fn check_object(place: &str, object: &ObjectSpec) -> Result<(), SpecError> {
    let key = |field: &str| format!("{place}: objects.{field}");
    finite(&key("position_mm"), &object.position_mm)?;
    finite(&key("rotation"), &object.rotation)?;
    match &object.shape {
        ShapeSpec::Plane { width_mm, height_mm } => {
            positive(&key("shape.width_mm"), *width_mm)?;
            positive(&key("shape.height_mm"), *height_mm)?;
        }
        ShapeSpec::Sphere { radius_mm } => positive(&key("shape.radius_mm"), *radius_mm)?,
        ShapeSpec::Step { width_mm, height_mm, jump_mm } => {
            positive(&key("shape.width_mm"), *width_mm)?;
            positive(&key("shape.height_mm"), *height_mm)?;
            finite(&key("shape.jump_mm"), &[*jump_mm])?;
        }
        ShapeSpec::Vase { profile_mm } => {
            finite(&key("shape.profile_mm"), profile_mm.as_flattened())?;
            let (good, key) = (Vase::new(profile_mm).is_some(), key("shape.profile_mm"));
            let remedy = "give [height, radius] pairs, 2 to 1000, heights rising, radii above 0, and no sudden narrowing \
                          between them (the curve through them must not reach the axis)";
            check(good, key, format!("{profile_mm:?}"), remedy)?;
        }
        ShapeSpec::Box { size_mm } => {
            positive(&key("shape.size_mm"), size_mm.iter().copied().fold(f64::INFINITY, f64::min))?;
            finite(&key("shape.size_mm"), size_mm)?;
        }
        ShapeSpec::Cylinder { radius_mm, height_mm } => {
            positive(&key("shape.radius_mm"), *radius_mm)?;
            positive(&key("shape.height_mm"), *height_mm)?;
        }
        ShapeSpec::Torus { major_mm, minor_mm } => {
            positive(&key("shape.minor_mm"), *minor_mm)?;
            let good = major_mm > minor_mm && *major_mm < 1e7;
            check(good, key("shape.major_mm"), major_mm, "it must be larger than minor_mm")?;
        }
        ShapeSpec::Mesh { scale, .. } => positive(&key("shape.scale"), *scale)?,
    }
    check_albedo(&key, object)?;
    check_material_and_deformation(&key, object)?;
    check_files(object, &|field| key(field))
}

fn check_albedo(key: &dyn Fn(&str) -> String, object: &ObjectSpec) -> Result<(), SpecError> {
    let (colors, length) = match &object.albedo {
        AlbedoSpec::Constant { rgb } => (vec![*rgb], ("", 1.0)),
        AlbedoSpec::Waves { from, to, period_mm } => (vec![*from, *to], ("period_mm", *period_mm)),
        AlbedoSpec::Checker { from, to, size_mm } => (vec![*from, *to], ("size_mm", *size_mm)),
        AlbedoSpec::Wood { from, to, ring_mm, .. } => (vec![*from, *to], ("ring_mm", *ring_mm)),
        AlbedoSpec::Image { size_mm: [w, h], .. } => (vec![], ("size_mm", w.min(*h))),
        AlbedoSpec::VertexColors { .. } => {
            let mesh = matches!(object.shape, ShapeSpec::Mesh { .. });
            check(
                mesh,
                key("albedo.kind"),
                "vertex-colors",
                "only a mesh has vertices with colors; give another kind",
            )?;
            return Ok(());
        }
    };
    for v in colors.as_flattened() {
        within(&key("albedo"), *v, 0.0, 1.0)?;
    }
    positive(&key(&format!("albedo.{}", length.0)), length.1)
}

fn check_material_and_deformation(key: &dyn Fn(&str) -> String, object: &ObjectSpec) -> Result<(), SpecError> {
    match object.material {
        MaterialSpec::Lambert => {}
        MaterialSpec::Glossy { roughness, reflectance } => {
            within(&key("material.roughness"), roughness, 0.05, 1.0)?;
            within(&key("material.reflectance"), reflectance, 0.0, 1.0)?;
        }
        MaterialSpec::Translucent { mean_free_path_mm, share } => {
            positive(&key("material.mean_free_path_mm"), mean_free_path_mm)?;
            within(&key("material.share"), share, 0.0, 1.0)?;
        }
    }
    let not_z = |axis: AxisSpec| {
        check(
            axis != AxisSpec::Z,
            key("deformation.axis"),
            "z",
            "a sheet in z = 0 bends about x or y; give one of them",
        )
    };
    match object.deformation {
        None => Ok(()),
        Some(DeformationSpec::Wave { amplitude_mm, wavelength_mm, phase, direction }) => {
            finite(&key("deformation.amplitude_mm, phase"), &[amplitude_mm, phase])?;
            positive(&key("deformation.wavelength_mm"), wavelength_mm)?;
            finite(&key("deformation.direction"), &direction)?;
            let length = direction.iter().map(|v| v * v).sum::<f64>().sqrt();
            let shown = format!("{direction:?}");
            check(length > 1e-6, key("deformation.direction"), shown, "give the direction in which the wave runs")
        }
        Some(DeformationSpec::Bend { curvature_per_mm, axis }) => {
            not_z(axis)?;
            within(&key("deformation.curvature_per_mm"), curvature_per_mm, -10.0, 10.0)
        }
        Some(DeformationSpec::Twist { rate_per_mm, .. }) => {
            within(&key("deformation.rate_per_mm"), rate_per_mm, -10.0, 10.0)
        }
    }
}
