//! Arguments of `patterns`.

use std::path::PathBuf;

use clap::Subcommand;
use nelu3d_scan::pattern::{
    Alacarte, Binary, Film, Gray, Hilbert, Mps, PhaseShift, RECOMMENDED_IMAGES, Ramp, Random, ScoreOptions, Sinusoid,
    Superposition, Triangle, Xor,
};

/// Arguments of `nelu3d patterns`: the family of patterns, or their score.
#[derive(Debug, Subcommand)]
pub(crate) enum PatternsCommand {
    /// The set to begin with: a fine sinusoid, a triangle wave and smooth noise.
    Recommended {
        /// Settings of the set.
        #[command(flatten)]
        settings: RecommendedArgs,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// One sinusoid, shifted in phase.
    #[command(alias = "sine")]
    Sinusoid {
        /// Settings of the family.
        #[command(flatten)]
        settings: Sinusoid,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// A triangle wave.
    Triangle {
        /// Settings of the family.
        #[command(flatten)]
        settings: Triangle,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// One ramp from dark to bright.
    Ramp {
        /// Settings of the family.
        #[command(flatten)]
        settings: Ramp,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// Smooth noise of a limited band.
    Random {
        /// Settings of the family.
        #[command(flatten)]
        settings: Random,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// Gray code.
    Gray {
        /// Settings of the family.
        #[command(flatten)]
        settings: Gray,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// Binary code.
    Binary {
        /// Settings of the family.
        #[command(flatten)]
        settings: Binary,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// Gray code without wide stripes (XOR-02, XOR-04).
    Xor {
        /// Settings of the family.
        #[command(flatten)]
        settings: Xor,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// Phase shifting of one or several periods.
    Phase {
        /// Settings of the family.
        #[command(flatten)]
        settings: PhaseShift,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// Micro phase shifting.
    Mps {
        /// Settings of the family.
        #[command(flatten)]
        settings: Mps,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// Points of a Hilbert curve.
    Hilbert {
        /// Settings of the family.
        #[command(flatten)]
        settings: Hilbert,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// Patterns optimized for decoding by normalized cross-correlation.
    Alacarte {
        /// Settings of the family.
        #[command(flatten)]
        settings: Alacarte,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// Stripes whose light adds up, which show how a camera's codes follow light; not for scanning.
    Superposition {
        /// Settings of the family.
        #[command(flatten)]
        settings: Superposition,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// A sinusoid, a triangle wave and smooth noise as red, green and blue.
    Rgb {
        /// Settings of the family.
        #[command(flatten)]
        settings: RgbArgs,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// A strip of color film, or a print on transparency.
    Film {
        /// Settings of the family.
        #[command(flatten)]
        settings: Film,
        /// Settings of the images.
        #[command(flatten)]
        sheet: PatternImageArgs,
    },
    /// Score images as a code: how well it tells its columns apart.
    Score(PatternScoreArgs),
}

/// Settings of the images, whatever their family.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Images")]
pub(crate) struct PatternImageArgs {
    /// Columns and rows of the light source's image.
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: [usize; 2],
    /// Direction in which the images change.
    #[arg(long, value_enum, default_value_t = AxisChoice::X)]
    pub axis: AxisChoice,
    /// Bits of a pixel.
    #[arg(long, value_name = "8|16", default_value_t = 8, value_parser = bits)]
    pub bits: u8,
    /// Gamma of the light source, whose inverse is applied to the codes: it shows code^G.
    #[arg(long, value_name = "G", default_value_t = 1.0, value_parser = gamma)]
    pub gamma: f64,
    /// Folder to write, new or left by an earlier call.
    #[arg(short, long, value_name = "DIR", default_value = "nelu3d-patterns")]
    pub output: PathBuf,
}

/// Directions in which images change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum AxisChoice {
    /// From column to column.
    X,
    /// From row to row.
    Y,
    /// The images of x, then those of y.
    Both,
}

/// Settings of the red, green and blue parts of family `rgb`.
#[derive(Debug, clap::Args)]
pub(crate) struct RgbArgs {
    /// Length of a period in red, px.
    #[arg(long, value_name = "PX", default_value_t = 20.0)]
    pub period: f64,
    /// Length of a period in green, px.
    #[arg(long, value_name = "PX", default_value_t = 200.0)]
    pub triangle_period: f64,
    /// Settings of the smooth noise in blue.
    #[command(flatten)]
    pub random: Random,
}

/// Settings of the recommended set.
#[derive(Debug, clap::Args)]
pub(crate) struct RecommendedArgs {
    /// Number of images beside white and black: more take longer and measure better.
    #[arg(long, value_name = "3|5|8", default_value_t = 3, value_parser = images)]
    pub images: usize,
}

/// Arguments of `nelu3d patterns score`.
#[derive(Debug, clap::Args)]
pub(crate) struct PatternScoreArgs {
    /// Folder of pattern images; white.png, black.png and inverse images (`_inv` in their names) are skipped.
    pub dir: PathBuf,
    /// Picture to write: the distance in code space of every two columns (.png).
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Distances beyond which two columns count as far apart, px.
    #[arg(long, value_name = "PX", value_delimiter = ',', default_values_t = ScoreOptions::default().distances_px)]
    pub beyond: Vec<usize>,
    /// Standard deviation of the noise of a normalized intensity.
    #[arg(long, value_name = "SIGMA", default_value_t = ScoreOptions::default().sigma, value_parser = sigma)]
    pub noise: f64,
    /// Number of noisy pixels to decode for each column.
    #[arg(
        long,
        value_name = "N",
        default_value_t = ScoreOptions::default().samples as u32,
        value_parser = clap::value_parser!(u32).range(1..=100_000)
    )]
    pub samples: u32,
    /// Seed of the noise.
    #[arg(long, value_name = "N", default_value_t = ScoreOptions::default().seed)]
    pub seed: u64,
}

/// Parses columns and rows.
pub(super) fn size(text: &str) -> Result<[usize; 2], String> {
    let sides =
        text.split_once(['x', 'X', '×']).and_then(|(w, h)| Some([w.trim().parse().ok()?, h.trim().parse().ok()?]));
    sides.ok_or_else(|| "columns and rows, as 1280x800".into())
}

/// Parses the number of images of a recommended set.
fn images(text: &str) -> Result<usize, String> {
    let images = text.parse().ok().filter(|n| RECOMMENDED_IMAGES.contains(n));
    images.ok_or_else(|| "3, 5 or 8".into())
}

/// Parses the bits of a pixel.
fn bits(text: &str) -> Result<u8, String> {
    match text {
        "8" => Ok(8),
        "16" => Ok(16),
        _ => Err("8 or 16".into()),
    }
}

/// Parses an exponent.
fn gamma(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(gamma) if (0.1..=10.0).contains(&gamma) => Ok(gamma),
        _ => Err("a number from 0.1 to 10".into()),
    }
}

/// Parses a standard deviation of normalized intensity.
fn sigma(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(sigma) if (0.0..=1.0).contains(&sigma) => Ok(sigma),
        _ => Err("a number from 0 to 1".into()),
    }
}
