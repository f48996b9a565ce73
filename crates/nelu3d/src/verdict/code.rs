//! The stable names of findings.

use serde::Serialize;

/// What a finding is about. The names in JSON (`field-below-noise`) are stable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Code {
    /// Corners fit the board badly, and no shared cause explains it.
    CornersMisfit,
    /// Wrong focal length or principal point, by the pattern of the corners' misfit.
    CameraIntrinsics,
    /// Missing or wrong lens distortion, by the pattern of the corners' misfit.
    CameraDistortion,
    /// A stretched print, by the pattern of the corners' misfit.
    PrintStretched,
    /// A bent board, by the pattern of the corners' misfit.
    BoardBent,
    /// What no image tells: the scale of everything, and the focal length where the boards face the camera.
    ScaleNotChecked,
    /// The boards' steps are longer or shorter than the stage's.
    ScaleContradicted,
    /// The boards span too little depth, or none.
    DepthRange,
    /// The field predicts unseen positions worse than noise allows.
    FieldBelowNoise,
    /// Positions have the same images, value for value.
    PositionsRepeat,
    /// One position does not fit the others.
    PositionDisagrees,
    /// Patterns of one position are in another order than at the others.
    PatternsSwapped,
    /// White and patterns of one position, or images of one pattern, were not exposed alike.
    ExposureJump,
    /// The camera or the board moved between the images of one position.
    PositionMoved,
    /// A part of a position's image is not used.
    PositionPartLeftOut,
    /// The codeword repeats along the rays of light of the camera within the volume.
    CodeRepeats,
    /// Images are not linear in light, by their noise.
    NonlinearResponse,
    /// A projector's response was found from scenes alone, whose depths are not known.
    ResponseFromScenes,
    /// The boards of the sweep are not where a calibrated projector's field has them.
    ProjectorDisagrees,
    /// Images were compressed with loss.
    LossyCompression,
    /// Much of what is lit is clipped.
    Clipped,
    /// A pattern has no light where the code should vary, or is lit as white is.
    PatternWithoutLight,
    /// One pattern of a scene does not fit the others.
    PatternDisagrees,
    /// Light that no pattern modulates is not in the black image.
    AmbientNotInBlack,
    /// The surface's codewords do not fit the field as well as noise allows.
    ResidualAboveNoise,
    /// Little of what is lit has a depth.
    LittleExplained,
    /// Camera or light source moved since the sweep.
    Drift,
    /// Whether projector or camera moved since the sweep was not checked: no board in view.
    DriftNotChecked,
    /// The field's own verdict was not good.
    FieldDoubtful,
}

impl Code {
    /// All codes.
    pub const ALL: [Code; 29] = [
        Code::CornersMisfit,
        Code::CameraIntrinsics,
        Code::CameraDistortion,
        Code::PrintStretched,
        Code::BoardBent,
        Code::ScaleNotChecked,
        Code::ScaleContradicted,
        Code::DepthRange,
        Code::FieldBelowNoise,
        Code::PositionsRepeat,
        Code::PositionDisagrees,
        Code::PatternsSwapped,
        Code::ExposureJump,
        Code::PositionMoved,
        Code::PositionPartLeftOut,
        Code::CodeRepeats,
        Code::NonlinearResponse,
        Code::ResponseFromScenes,
        Code::ProjectorDisagrees,
        Code::LossyCompression,
        Code::Clipped,
        Code::PatternWithoutLight,
        Code::PatternDisagrees,
        Code::AmbientNotInBlack,
        Code::ResidualAboveNoise,
        Code::LittleExplained,
        Code::Drift,
        Code::DriftNotChecked,
        Code::FieldDoubtful,
    ];

    /// Returns the code as it stands in JSON.
    pub fn name(self) -> String {
        match serde_json::to_value(self) {
            Ok(serde_json::Value::String(name)) => name,
            _ => unreachable!("a variant without content is a string"),
        }
    }
}
