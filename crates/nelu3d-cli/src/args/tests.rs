use clap::Parser;
use nelu3d::from_projector::FromProjectorOptions;
use nelu3d::sequence::MotionOptions;
use nelu3d::{CalibrationOptions, ReconstructionOptions};
use nelu3d_baselines::projector::ProjectorOptions;
use nelu3d_baselines::{DecodeOptions, Method};
use nelu3d_evaluate::cad::CadOptions;
use nelu3d_scan::pattern::{Alacarte, Binary, Film, Gray, Mps, PhaseShift, Ramp, ScoreOptions};

use super::*;

#[test]
fn the_command_line_is_consistent() {
    <Args as clap::CommandFactory>::command().debug_assert();
}

/// Parses a command line; `line` is what follows the name of the program.
fn parse(line: &str) -> Command {
    Args::try_parse_from(std::iter::once("nelu3d").chain(line.split(' '))).unwrap_or_else(|e| panic!("{e}")).command
}

/// A default is stated once: without options, every command takes the options that the library has by default.
#[test]
fn without_options_the_defaults_are_those_of_the_library() {
    let Command::Calibrate(a) = parse("calibrate rig") else { panic!() };
    assert_eq!(a.options, CalibrationOptions::default());
    assert_eq!(a.projector, FromProjectorOptions::default());
    let Command::Reconstruct(a) = parse("reconstruct rig scene") else { panic!() };
    assert_eq!(a.options, ReconstructionOptions::default());
    let Command::Sequence(a) = parse("sequence rig frames") else { panic!() };
    assert_eq!(a.options, ReconstructionOptions::default());
    assert_eq!(a.motion, MotionOptions::default());
    for method in <Method as clap::ValueEnum>::value_variants() {
        let name = <Method as clap::ValueEnum>::to_possible_value(method).expect("not hidden");
        let Command::Decode(a) = parse(&format!("decode rig scene --method {}", name.get_name())) else { panic!() };
        assert_eq!(a.options, DecodeOptions::new(*method));
    }
    let Command::Projector(a) = parse("projector rig") else { panic!() };
    assert_eq!(a.options, ProjectorOptions::default());
    let Command::Evaluate(a) = parse("evaluate result --cad mesh.ply") else { panic!() };
    assert_eq!((a.scale, a.within), (CadOptions::default().scale, CadOptions::default().within_mm));
    // Devices: the same for all work, but `bench` measures the CPU unless told.
    let Command::Demo(a) = parse("demo") else { panic!() };
    assert_eq!(a.device, ReconstructionOptions::default().device);
    let Command::Experiment(a) = parse("experiment") else { panic!() };
    assert_eq!(a.device, ReconstructionOptions::default().device);
}

/// Defaults of pattern families; of those that are not named here, the command line alone has defaults.
#[test]
fn without_options_patterns_are_those_of_the_library() {
    macro_rules! check {
        ($($name:literal $variant:ident $settings:expr;)*) => {$(
            let Command::Patterns(PatternsCommand::$variant { settings, sheet }) =
                parse(concat!("patterns ", $name, " --size 8x8")) else { panic!() };
            assert_eq!(settings, $settings);
            assert_eq!((sheet.axis, sheet.bits, sheet.gamma), (AxisChoice::X, 8, 1.0));
        )*};
    }
    check! {
        "ramp" Ramp Ramp::default();
        "gray" Gray Gray::default();
        "binary" Binary Binary::default();
        "phase" Phase PhaseShift::default();
        "mps" Mps Mps::default();
        "alacarte" Alacarte Alacarte::default();
        "film" Film Film::default();
    }
    let Command::Patterns(PatternsCommand::Score(a)) = parse("patterns score dir") else { panic!() };
    let options = ScoreOptions { distances_px: a.beyond, sigma: a.noise, samples: a.samples as usize, seed: a.seed };
    assert_eq!(options, ScoreOptions::default());
}
