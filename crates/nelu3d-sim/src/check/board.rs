//! Checks of the board and of its sweep.

use super::rules::{check, finite, positive, within};
use crate::spec::{BoardSpec, Spec, SpecError, SweepSpec};

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
    Ok(())
}

/// Checks the sweep.
pub(super) fn check_sweep(sweep: &SweepSpec) -> Result<(), SpecError> {
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
        SweepSpec::Handheld { position_sigma_mm, tilt_sigma, .. } => {
            within("sweep.position_sigma_mm", *position_sigma_mm, 0.0, 1e3)?;
            within("sweep.tilt_sigma", *tilt_sigma, 0.0, 1.0)
        }
    }
}
