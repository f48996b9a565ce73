//! What is typed. What it means is decided by each command.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::{Parser, Subcommand};
use nelu3d_baselines::lookup3d::Rank;
use nelu3d_field::device::Choice;
use nelu3d_scan::image::Channels;
use nelu3d_scan::pattern::{
    Alacarte, Binary, Film, Gray, Hilbert, Mps, PhaseShift, Ramp, Random, Sinusoid, Triangle, Xor,
};

/// What scripts can rely on.
const EXIT_CODES: &str = "Exit codes: 0 done, 1 failed or stopped by Ctrl-C, 2 wrong usage. What fails says so in one \
                          sentence on standard error, and leaves no half-written output behind.";

/// 3D scanning with a camera and any light source that throws a pattern.
///
/// No projector model: a board is moved through the scene once, and what each point of space looks like under the
/// patterns is learned (a color field). Scenes are then explained by it. Start with `nelu3d demo`.
#[derive(Debug, Parser)]
#[command(name = "nelu3d", version, max_term_width = 100, after_help = EXIT_CODES)]
pub(crate) struct Args {
    /// Options of every command.
    #[command(flatten)]
    pub global: Global,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// Options of every command.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Global options")]
pub(crate) struct Global {
    /// Print the answer as one JSON value on standard output.
    #[arg(long, global = true)]
    pub json: bool,
    /// No progress on standard error.
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Log more; twice for much more. NELU3D_LOG takes levels by module: `debug`, or `nelu3d::reconstruct=debug,info`.
    #[arg(long, short, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// Threads to use (default: all).
    #[arg(long, global = true, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Simulate a small scanner, calibrate it, reconstruct a scene and judge the result: no input, no hardware.
    Demo(Demo),
    /// Write the rig folder of a virtual scanner, with exact truth.
    Simulate(Simulate),
    /// Make the images a light source shows, or judge such images as a code.
    #[command(subcommand)]
    Patterns(Patterns),
    /// Turn a recording, a folder of numbered frames, into a sequence, a scene or the sweep of a rig.
    Import(Import),
    /// List everything that is wrong with a rig folder, in one go.
    Check(Check),
    /// Turn the board sweep of a rig into a color field.
    Calibrate(Calibrate),
    /// Reconstruct a scene.
    Reconstruct(Reconstruct),
    /// Reconstruct a scene that moves, frame after frame; goes on where it was stopped.
    Sequence(Sequence),
    /// Decode a scene with a method that knows the projector: what NeLU3D is compared with.
    Decode(Decode),
    /// Calibrate the projector from the sweep, if it has Gray-code images along x and y; only `decode` needs it.
    Projector(Projector),
    /// Judge a result: against the truth, a mesh of the part, or another result.
    Evaluate(Evaluate),
    /// Run the paper's tables and figures, or studies of your own, on virtual and given rigs.
    Experiment(Experiment),
    /// Lookup tables of the sweep, in the files of the LookUp3D tools.
    Table(Table),
    /// Measure this machine, and how close the kernels and training steps come to what it allows.
    Bench(Bench),
    /// List the GPUs that were found, and why one is not used.
    Devices,
}

/// `nelu3d demo`
#[derive(Debug, clap::Args)]
pub(crate) struct Demo {
    /// Folder to write, new or left by an earlier demo.
    #[arg(short, long, value_name = "DIR", default_value = "nelu3d-demo")]
    pub output: PathBuf,
    /// Where the heavy work is done: auto (a GPU, if there is one), cpu, gpu, or gpu:N as in `nelu3d devices`.
    #[arg(long, default_value_t)]
    pub device: Choice,
}

/// `nelu3d simulate`
#[derive(Debug, clap::Args)]
pub(crate) struct Simulate {
    /// Name of a preset, or a file that describes a scanner (.toml).
    #[arg(value_name = "PRESET|SPEC.toml")]
    pub spec: String,
    /// Rig folder to write.
    #[arg(short, long, value_name = "RIG")]
    pub output: PathBuf,
}

/// `nelu3d patterns`
#[derive(Debug, Subcommand)]
pub(crate) enum Patterns {
    /// One sinusoid, shifted in phase.
    #[command(alias = "sine")]
    Sinusoid {
        /// Settings of the family.
        #[command(flatten)]
        settings: Sinusoid,
        /// The images.
        #[command(flatten)]
        sheet: Sheet,
    },
    /// A triangle wave.
    Triangle {
        /// Settings of the family.
        #[command(flatten)]
        settings: Triangle,
        /// The images.
        #[command(flatten)]
        sheet: Sheet,
    },
    /// One ramp from dark to bright.
    Ramp {
        /// Settings of the family.
        #[command(flatten)]
        settings: Ramp,
        /// The images.
        #[command(flatten)]
        sheet: Sheet,
    },
    /// Smooth noise of a limited band.
    Random {
        /// Settings of the family.
        #[command(flatten)]
        settings: Random,
        /// The images.
        #[command(flatten)]
        sheet: Sheet,
    },
    /// Gray code.
    Gray {
        /// Settings of the family.
        #[command(flatten)]
        settings: Gray,
        /// The images.
        #[command(flatten)]
        sheet: Sheet,
    },
    /// Binary code.
    Binary {
        /// Settings of the family.
        #[command(flatten)]
        settings: Binary,
        /// The images.
        #[command(flatten)]
        sheet: Sheet,
    },
    /// Gray code without wide stripes (XOR-02, XOR-04).
    Xor {
        /// Settings of the family.
        #[command(flatten)]
        settings: Xor,
        /// The images.
        #[command(flatten)]
        sheet: Sheet,
    },
    /// Phase shifting of one or several periods.
    Phase {
        /// Settings of the family.
        #[command(flatten)]
        settings: PhaseShift,
        /// The images.
        #[command(flatten)]
        sheet: Sheet,
    },
    /// Micro phase shifting.
    Mps {
        /// Settings of the family.
        #[command(flatten)]
        settings: Mps,
        /// The images.
        #[command(flatten)]
        sheet: Sheet,
    },
    /// Points of a Hilbert curve.
    Hilbert {
        /// Settings of the family.
        #[command(flatten)]
        settings: Hilbert,
        /// The images.
        #[command(flatten)]
        sheet: Sheet,
    },
    /// Patterns optimized for decoding by normalized cross-correlation.
    Alacarte {
        /// Settings of the family.
        #[command(flatten)]
        settings: Alacarte,
        /// The images.
        #[command(flatten)]
        sheet: Sheet,
    },
    /// A sinusoid, a triangle wave and smooth noise as red, green and blue.
    Rgb {
        /// Settings of the family.
        #[command(flatten)]
        settings: RgbParts,
        /// The images.
        #[command(flatten)]
        sheet: Sheet,
    },
    /// A strip of color film, or a print on transparency.
    Film {
        /// Settings of the family.
        #[command(flatten)]
        settings: Film,
        /// The images.
        #[command(flatten)]
        sheet: Sheet,
    },
    /// Judge images as a code: how well it tells its columns apart.
    Score(PatternScore),
}

/// What the images of any family are.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Images")]
pub(crate) struct Sheet {
    /// Columns and rows of the light source's image.
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: [usize; 2],
    /// Direction in which the images change.
    #[arg(long, value_enum, default_value_t = Axes::X)]
    pub axis: Axes,
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

/// Directions of change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Axes {
    /// From column to column.
    X,
    /// From row to row.
    Y,
    /// The images of x, then those of y.
    Both,
}

/// What red, green and blue show.
#[derive(Debug, clap::Args)]
pub(crate) struct RgbParts {
    /// Length of a period in red, px.
    #[arg(long, value_name = "PX", default_value_t = 20.0)]
    pub period: f64,
    /// Length of a period in green, px.
    #[arg(long, value_name = "PX", default_value_t = 200.0)]
    pub triangle_period: f64,
    /// Smooth noise in blue.
    #[command(flatten)]
    pub random: Random,
}

/// `nelu3d patterns score`
#[derive(Debug, clap::Args)]
pub(crate) struct PatternScore {
    /// Folder of pattern images; white.png, black.png and inverse images (`_inv` in their names) are left aside.
    pub dir: PathBuf,
    /// Picture to write: the distance in code space of every two columns (.png).
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Columns further apart than each of these are far, px.
    #[arg(long, value_name = "PX", value_delimiter = ',', default_value = "2,10,50")]
    pub beyond: Vec<usize>,
    /// Noise: standard deviation of a normalized intensity.
    #[arg(long, value_name = "SIGMA", default_value_t = 0.02, value_parser = sigma)]
    pub noise: f64,
    /// Noisy pixels to decode for each column.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub samples: u32,
    /// Seed of the noise.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
}

fn size(text: &str) -> Result<[usize; 2], String> {
    let sides =
        text.split_once(['x', 'X', '×']).and_then(|(w, h)| Some([w.trim().parse().ok()?, h.trim().parse().ok()?]));
    sides.ok_or_else(|| "columns and rows, as 1280x800".into())
}

fn bits(text: &str) -> Result<u8, String> {
    match text {
        "8" => Ok(8),
        "16" => Ok(16),
        _ => Err("8 or 16".into()),
    }
}

fn gamma(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(gamma) if (0.1..=10.0).contains(&gamma) => Ok(gamma),
        _ => Err("a number from 0.1 to 10".into()),
    }
}

fn sigma(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(sigma) if (0.0..=1.0).contains(&sigma) => Ok(sigma),
        _ => Err("a number from 0 to 1".into()),
    }
}

/// `nelu3d import`
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("target").required(true))]
pub(crate) struct Import {
    /// Folder of numbered frames: PNG, TIFF, or uncompressed DNG as Chronos cameras record it.
    pub frames: PathBuf,
    /// Rig folder, or its rig.toml; a new one needs --camera.
    pub rig: PathBuf,
    /// Write RIG/sequences/NAME: a frame of every group of images.
    #[arg(long, value_name = "NAME", group = "target")]
    pub sequence: Option<String>,
    /// Write RIG/scenes/NAME: one group of images, or with --mean several.
    #[arg(long, value_name = "NAME", group = "target")]
    pub scene: Option<String>,
    /// Write RIG/calibration: a board position of every group of images.
    #[arg(long, group = "target")]
    pub calibration: bool,
    /// What consecutive frames are, over and over again: white, black, names of patterns, or skip for one to leave out
    /// (default: the images of the pattern set, then white).
    #[arg(long, value_name = "IMAGE,…", value_delimiter = ',')]
    pub order: Option<Vec<String>>,
    /// Pattern set that the default order is of (default: the rig's first), or the name of a new rig's.
    #[arg(long, value_name = "NAME")]
    pub set: Option<String>,
    /// First frame to use, counted from 1 in the order of the names.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub first: Option<u32>,
    /// Last frame to use.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub last: Option<u32>,
    /// Use every Nth group only.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
    /// Average all groups into one, for less noise where nothing moved.
    #[arg(long, conflicts_with = "sequence")]
    pub mean: bool,
    /// The light off, for recordings without it: an image, or a folder of images to average.
    #[arg(long, value_name = "FILE|DIR")]
    pub black: Option<PathBuf>,
    /// Replace what an earlier import wrote there.
    #[arg(long)]
    pub force: bool,
    /// What a new rig needs.
    #[command(flatten)]
    pub sensor: Sensor,
}

/// What a new rig needs to know of the camera.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "New rigs")]
pub(crate) struct Sensor {
    /// Intrinsics (default: RIG/camera.json).
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// How the sensor delivers color: mono, rgb, bayer-rggb, bayer-bggr, bayer-grbg, bayer-gbrg (default: as DNG says).
    #[arg(long, value_name = "CHANNELS", value_parser = channels)]
    pub channels: Option<Channels>,
    /// Sensor code for no light (default: as DNG says, or 0).
    #[arg(long, value_name = "CODE", value_parser = code)]
    pub black_level: Option<f64>,
    /// Sensor code at and above which a value is clipped (default: as DNG says, or by the frames' codes).
    #[arg(long, value_name = "CODE", value_parser = code)]
    pub saturation: Option<f64>,
}

fn channels(text: &str) -> Result<Channels, String> {
    Channels::from_name(text).ok_or_else(|| format!("one of {}", Channels::ALL.map(Channels::name).join(", ")))
}

fn code(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(code) if (0.0..=65535.0).contains(&code) => Ok(code),
        _ => Err("a number from 0 to 65535".into()),
    }
}

/// `nelu3d check`
#[derive(Debug, clap::Args)]
pub(crate) struct Check {
    /// Rig folder, or its rig.toml.
    pub rig: PathBuf,
}

/// `nelu3d calibrate`
#[derive(Debug, clap::Args)]
pub(crate) struct Calibrate {
    /// Rig folder, or its rig.toml.
    pub rig: PathBuf,
    /// Pattern set (default: the rig's first).
    #[arg(long, value_name = "NAME")]
    pub set: Option<String>,
    /// Field to write (default: RIG/fields/SET.safetensors).
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Measure the cross-talk of a color camera on this scene, of which some is saturated in color, and keep it with the field:
    /// scenes with little color then need not tell it themselves.
    #[arg(long, value_name = "SCENE")]
    pub colors: Option<String>,
    /// Compute the field from the calibrated projector and the projected images instead of a sweep
    #[arg(long)]
    pub from_projector: bool,
    /// Settings of that.
    #[command(flatten)]
    pub projector: nelu3d::from_projector::FromProjectorOptions,
    /// Settings of the method.
    #[command(flatten)]
    pub options: nelu3d::CalibrationOptions,
}

/// `nelu3d reconstruct`
#[derive(Debug, clap::Args)]
pub(crate) struct Reconstruct {
    /// Rig folder, or its rig.toml.
    pub rig: PathBuf,
    /// A name under RIG/scenes, or a folder with the same files.
    pub scene: String,
    /// Pattern set (default: the rig's first).
    #[arg(long, value_name = "NAME")]
    pub set: Option<String>,
    /// Color field (default: RIG/fields/SET.safetensors, as `calibrate` writes it).
    #[arg(long, value_name = "FILE")]
    pub field: Option<PathBuf>,
    /// Result folder to write (default: RIG/results/SCENE-SET).
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Judge the finished result against this truth folder, in result.json and the report.
    #[arg(long, value_name = "DIR")]
    pub truth: Option<PathBuf>,
    /// Record the error after every iteration against processor time, in result.json.
    #[arg(long, requires = "truth")]
    pub trace: bool,
    /// Write the surface in these formats too.
    #[arg(long, value_name = "FORMAT", value_delimiter = ',')]
    pub mesh: Vec<MeshFormat>,
    /// Settings of the method.
    #[command(flatten)]
    pub options: nelu3d::ReconstructionOptions,
}

/// `nelu3d sequence`
#[derive(Debug, clap::Args)]
pub(crate) struct Sequence {
    /// Rig folder, or its rig.toml.
    pub rig: PathBuf,
    /// A name under RIG/sequences, or a folder of frames.
    pub sequence: String,
    /// Pattern set (default: the rig's first).
    #[arg(long, value_name = "NAME")]
    pub set: Option<String>,
    /// Color field (default: RIG/fields/SET.safetensors, as `calibrate` writes it).
    #[arg(long, value_name = "FILE")]
    pub field: Option<PathBuf>,
    /// Folder to write, or to go on with: one result folder per frame (default: RIG/results/SEQUENCE-SET).
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Judge every frame against the truth/ in its folder.
    #[arg(long)]
    pub truth: bool,
    /// Frames from one that begins anew to the next. Stretches between them can be computed in parallel.
    #[arg(long, value_name = "N", default_value = "30")]
    pub keyframe: NonZeroUsize,
    /// Compute only this part of the frames, as 1/8 to 8/8; parts may run at the same time, on any machines that share the folder.
    #[arg(long, value_name = "I/N")]
    pub shard: Option<nelu3d::sequence::Shard>,
    /// Compute nothing: write a script for the Slurm scheduler that does (`sbatch FILE`).
    #[arg(long, value_name = "FILE", conflicts_with = "shard")]
    pub slurm: Option<PathBuf>,
    /// Tasks of the Slurm script (default: one per stretch between keyframes).
    #[arg(long, value_name = "N", requires = "slurm")]
    pub tasks: Option<NonZeroUsize>,
    /// Frames per second at which the moving surface is played.
    #[arg(long, value_name = "FPS", default_value_t = 10.0, value_parser = fps)]
    pub fps: f64,
    /// What to do about motion.
    #[command(flatten)]
    pub motion: nelu3d::sequence::MotionOptions,
    /// Settings of the method.
    #[command(flatten)]
    pub options: nelu3d::ReconstructionOptions,
}

fn fps(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(fps) if (0.01..=1000.0).contains(&fps) => Ok(fps),
        _ => Err("a number from 0.01 to 1000".into()),
    }
}

/// `nelu3d decode`
#[derive(Debug, clap::Args)]
pub(crate) struct Decode {
    /// Rig folder, or its rig.toml.
    pub rig: PathBuf,
    /// A name under RIG/scenes, or a folder with the same files.
    pub scene: String,
    /// Pattern set (default: the rig's first).
    #[arg(long, value_name = "NAME")]
    pub set: Option<String>,
    /// Result folder to write (default: RIG/results/SCENE-SET-METHOD).
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Judge the finished result against this truth folder, in result.json and the report.
    #[arg(long, value_name = "DIR")]
    pub truth: Option<PathBuf>,
    /// Write the surface in these formats too.
    #[arg(long, value_name = "FORMAT", value_delimiter = ',')]
    pub mesh: Vec<MeshFormat>,
    /// Settings of the method.
    #[command(flatten)]
    pub options: nelu3d_baselines::DecodeOptions,
}

/// `nelu3d projector`
#[derive(Debug, clap::Args)]
pub(crate) struct Projector {
    /// Rig folder, or its rig.toml.
    pub rig: PathBuf,
    /// Pattern set: binary codes along x and y (default: the first such).
    #[arg(long, value_name = "NAME")]
    pub set: Option<String>,
    /// File to write (default: RIG/projector.json).
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Replace the file if it exists.
    #[arg(long)]
    pub force: bool,
    /// Settings of the calibration.
    #[command(flatten)]
    pub options: nelu3d_baselines::projector::ProjectorOptions,
}

/// Mesh files besides mesh.ply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum MeshFormat {
    /// Wavefront, text.
    Obj,
    /// Stereolithography, binary.
    Stl,
    /// glTF, binary.
    Glb,
}

/// `nelu3d evaluate`
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("reference").required(true))]
pub(crate) struct Evaluate {
    /// Result folder.
    pub result: PathBuf,
    /// Truth folder: depth.npy and mask.png.
    #[arg(long, value_name = "DIR", group = "reference")]
    pub truth: Option<PathBuf>,
    /// Another result of the same camera.
    #[arg(long, value_name = "RESULT", group = "reference")]
    pub against: Option<PathBuf>,
    /// Mesh of the part, which is laid onto the scan: .ply, .obj or .stl, mm, anywhere in space.
    #[arg(long, value_name = "MESH", group = "reference")]
    pub cad: Option<PathBuf>,
    /// Millimeters per unit of the mesh: 1000 for meters, 25.4 for inches.
    #[arg(long, value_name = "S", default_value_t = 1.0, requires = "cad", value_parser = positive)]
    pub scale: f64,
    /// Where the mesh lies, about: cam_from_cad of an alignment.json, or sixteen numbers row by row, mm.
    #[arg(long, value_name = "FILE", requires = "cad")]
    pub initial_pose: Option<PathBuf>,
    /// Leave the mesh where it is: in the camera's frame, or where --initial-pose puts it.
    #[arg(long, requires = "cad")]
    pub no_align: bool,
    /// Points closer to the mesh are of the part, mm (default: 1 % of the mesh's diagonal).
    #[arg(long, value_name = "MM", requires = "cad", value_parser = positive)]
    pub within: Option<f64>,
    /// Folder to write: distances, histogram, colored surface, report.
    #[arg(short, long, value_name = "DIR", conflicts_with = "truth")]
    pub output: Option<PathBuf>,
    /// Calibrated projector: errors in its columns, too.
    #[arg(long, value_name = "FILE", conflicts_with = "rig")]
    pub projector: Option<PathBuf>,
    /// Rig folder whose projector to use for that.
    #[arg(long, value_name = "RIG")]
    pub rig: Option<PathBuf>,
}

/// `nelu3d experiment`
#[derive(Debug, clap::Args)]
pub(crate) struct Experiment {
    /// An experiment that comes with the program, or a file that describes one (.toml); none lists them.
    #[arg(value_name = "NAME|FILE.toml")]
    pub name: Option<String>,
    /// Folder for rigs, results, tables and pages. What an earlier run left there is not computed again.
    #[arg(short, long, value_name = "DIR", default_value = "nelu3d-experiments")]
    pub output: PathBuf,
    /// A small version, in a minute or so: to see that it works, not to learn anything.
    #[arg(long)]
    pub quick: bool,
    /// Where calibrations, reconstructions and sequences do their heavy work: auto, cpu, gpu, or gpu:N as in `nelu3d devices`.
    #[arg(long, default_value_t)]
    pub device: Choice,
    /// Seeds instead of the experiment's own.
    #[arg(long, value_name = "N", value_delimiter = ',', num_args = 1..)]
    pub seeds: Option<Vec<u64>>,
    /// Also take over what another build of this program computed there.
    #[arg(long)]
    pub reuse: bool,
}

/// `nelu3d table`
#[derive(Debug, clap::Args)]
pub(crate) struct Table {
    /// What to do with it.
    #[command(subcommand)]
    pub command: TableCommand,
}

/// What is done with lookup tables.
#[derive(Debug, Subcommand)]
pub(crate) enum TableCommand {
    /// Write the table of a rig's sweep: .npy, or .npz with --low-rank.
    Export(TableExport),
    /// Say what is in a file.
    Info(TableInfo),
}

/// `nelu3d table export`
#[derive(Debug, clap::Args)]
pub(crate) struct TableExport {
    /// Rig folder, or its rig.toml.
    pub rig: PathBuf,
    /// Pattern set (default: the rig's first).
    #[arg(long, value_name = "NAME")]
    pub set: Option<String>,
    /// File to write.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Keep every Nth pixel and row only.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub stride: usize,
    /// Write factors of so many terms per channel instead; "auto": as few as lose no more than the table's own noise.
    #[arg(long, value_name = "R|auto", value_parser = rank)]
    pub low_rank: Option<Rank>,
}

/// `nelu3d table info`
#[derive(Debug, clap::Args)]
pub(crate) struct TableInfo {
    /// The file, .npy or .npz.
    pub file: PathBuf,
}

fn rank(text: &str) -> Result<Rank, String> {
    match text.parse() {
        Ok(rank @ 1..) => Ok(Rank::Fixed(rank)),
        _ if text == "auto" => Ok(Rank::Auto),
        _ => Err("a number from 1, or \"auto\"".into()),
    }
}

/// `nelu3d bench`
#[derive(Debug, clap::Args)]
pub(crate) struct Bench {
    /// Only kernels and steps with this in their name; "step" for all training steps.
    #[arg(default_value = "")]
    pub filter: String,
    /// Processor seconds for each kernel and step; on a GPU, seconds for each phase of a step of recipe `paper`.
    #[arg(long, value_name = "S", default_value_t = 0.5, value_parser = seconds)]
    pub seconds: f64,
    /// What is measured: cpu, or a GPU, as gpu or gpu:N of `nelu3d devices`.
    #[arg(long, default_value_t = Choice::Cpu)]
    pub device: Choice,
    /// Samples of the step on a GPU.
    #[arg(long, value_name = "N", default_value_t = 262_144, value_parser = clap::value_parser!(usize))]
    pub samples: usize,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(v) if (1e-9..=1e9).contains(&v) => Ok(v),
        _ => Err("a number above 0".into()),
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(secs) if (0.0..=60.0).contains(&secs) => Ok(secs),
        _ => Err("a number from 0 to 60".into()),
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_command_line_is_consistent() {
        <super::Args as clap::CommandFactory>::command().debug_assert();
    }
}
