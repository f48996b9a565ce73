//! Columns, correlation and interpolation on sinusoids.

use nelu3d_baselines::zncc::{CodewordTable, Refiner, centered, largest};

use crate::sinusoids::sinusoids;

#[test]
fn columns_come_back_under_any_light_and_between_columns() {
    // Together they repeat after 520 columns.
    let axis = sinusoids(400, &[(40.0, 3), (52.0, 3)]);
    let planes: Vec<(usize, usize)> = (0..6).map(|i| (i, i)).collect();
    let table = CodewordTable::new(&axis, &planes, 0.0);
    let mut refiner = Refiner::new(6);
    let (mut code, mut scores) = (vec![0.0; 6], Vec::new());
    for i in 20..3700 {
        let u = i as f32 * 0.1;
        let p: Vec<f32> = (0..6).map(|j| 0.2 + 0.31 * table.eval(j, u).0).collect();
        let norm = centered(&p, &mut code);
        table.correlate(&code, 0, 399, &mut scores);
        let (at, best) = largest(&scores);
        assert!(best <= norm * 1.0001 && best > 0.99 * norm);
        let (found, _) = refiner.refine(&table, &p, at as f32, 1e-6).unwrap();
        assert!((found - u).abs() < 0.01, "{found} for {u}");
    }
}

#[test]
fn interpolation_passes_through_the_columns() {
    let axis = sinusoids(64, &[(16.0, 3)]);
    let table = CodewordTable::new(&axis, &[(0, 0), (1, 1), (2, 2)], 0.0);
    for u in 0..64 {
        assert!((table.eval(1, u as f32).0 - axis.lines[1].values[u]).abs() < 1e-6);
    }
    for i in 20..600 {
        let u = i as f32 * 0.1;
        let slope = (table.eval(1, u + 0.01).0 - table.eval(1, u - 0.01).0) / 0.02;
        assert!((slope - table.eval(1, u).1).abs() < 0.01, "{u}");
    }
}
