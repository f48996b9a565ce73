//! Checks of the board and of its sweep.

use super::rules::{check, finite, positive, within};
use crate::spec::{AxisSpec, BoardSpec, HandsSpec, Spec, SpecError, SweepSpec};
use crate::sweep::try_sweep_poses;

/// Checks the board and how it is printed.
pub(super) fn check_board(spec: &Spec) -> Result<(), SpecError> {
    let [x0, y0, x1, y1] = spec.board.extent_mm();
    finite("board.extent_mm", &[x0, y0, x1, y1])?;
    for albedo in spec.board_albedo {
        within("board_albedo", albedo, 0.0, 1.0)?;
    }
    let shown = format!("{:?}", [x0, y0, x1, y1]);
    check(x0 < x1 && y0 < y1, "board.extent_mm", shown, "it must be [x_min, y_min, x_max, y_max]")?;
    if let BoardSpec::Charuco { columns, rows, square_mm, .. }
    | BoardSpec::Chessboard { columns, rows, square_mm, .. } = &spec.board
    {
        check((3..=1000).contains(columns), "board.columns", columns, "give 3 to 1000 squares")?;
        check((3..=1000).contains(rows), "board.rows", rows, "give 3 to 1000 squares")?;
        positive("board.square_mm", *square_mm)?;
    }
    if let Some(dpi) = spec.print_dpi {
        within("print_dpi", dpi, 1.0, 100_000.0)?;
    }
    if let Some(bend) = &spec.board_bend {
        let remedy = "a board bends about x or y; give one of them";
        check(bend.axis != AxisSpec::Z, "board_bend.axis", "z", remedy)?;
        let length = if bend.axis == AxisSpec::X { y1 - y0 } else { x1 - x0 };
        within("board_bend.sagitta_mm", bend.sagitta_mm, -0.2 * length, 0.2 * length)?;
    }
    if let Some(curl) = &spec.board_curl {
        let diagonal = (x1 - x0).hypot(y1 - y0);
        check(curl.length_mm > 0.0, "board_curl.length_mm", curl.length_mm, "give more than 0")?;
        within("board_curl.length_mm", curl.length_mm, 0.0, diagonal)?;
        within("board_curl.height_mm", curl.height_mm, -0.5 * curl.length_mm, 0.5 * curl.length_mm)?;
    }
    Ok(())
}

/// Checks the sweep, after everything that its poses depend on: camera and board.
pub(super) fn check_sweep(spec: &Spec) -> Result<(), SpecError> {
    let sweep = &spec.sweep;
    within("sweep.positions", sweep.positions() as f64, 3.0, 100_000.0)?;
    let (SweepSpec::Stage { first_mm, last_mm, center_mm, .. }
    | SweepSpec::Handheld { first_mm, last_mm, center_mm, .. }) = sweep;
    positive("sweep.first_mm", *first_mm)?;
    positive("sweep.last_mm", *last_mm)?;
    finite("sweep.center_mm", center_mm)?;
    match sweep {
        SweepSpec::Stage { slope, rotation, step_error_mm, tilt_jitter, .. } => {
            within("sweep.tilt_jitter", *tilt_jitter, 0.0, 1.0)?;
            finite("sweep.slope", slope)?;
            finite("sweep.rotation", rotation)?;
            within("sweep.step_error_mm", *step_error_mm, 0.0, 1e3)
        }
        SweepSpec::Handheld { position_sigma_mm, tilt_sigma, max_tilt, min_in_view, hands, .. } => {
            within("sweep.position_sigma_mm", *position_sigma_mm, 0.0, 1e3)?;
            within("sweep.tilt_sigma", *tilt_sigma, 0.0, 1.0)?;
            within("sweep.max_tilt", max_tilt.unwrap_or(1.0), 0.0, 1.5)?;
            within("sweep.min_in_view", *min_in_view, 0.0, 1.0)?;
            if let Some(hands) = hands {
                check_hands(hands)?;
            }
            try_sweep_poses(spec).map(drop).map_err(|position| SpecError::Value {
                key: "sweep.min_in_view, max_tilt".into(),
                value: format!("{min_in_view}, {max_tilt:?}"),
                remedy: format!(
                    "no pose of position {position} keeps to them; allow more, or change center_mm, the depths or the \
                     deviations"
                ),
            })
        }
    }
}

fn check_hands(hands: &HandsSpec) -> Result<(), SpecError> {
    within("sweep.hands.number", hands.number as f64, 1.0, 8.0)?;
    within("sweep.hands.size_mm", hands.size_mm, 1.0, 1e3)?;
    for albedo in hands.albedo {
        within("sweep.hands.albedo", albedo, 0.0, 1.0)?;
    }
    Ok(())
}
