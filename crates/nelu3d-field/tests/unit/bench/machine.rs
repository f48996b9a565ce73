use nelu3d_field::bench::{Machine, Rate, interpolate};

#[test]
fn rates_between_and_beyond_the_measured_sizes() {
    let rate = |table_bytes, lines_per_sec| Rate { table_bytes, lines_per_sec };
    let rates = [rate(1 << 10, 8.0), rate(1 << 20, 4.0)];
    assert_eq!(interpolate(&rates, 1 << 5), 8.0);
    assert!((interpolate(&rates, 1 << 15) - 6.0).abs() < 1e-12);
    assert_eq!(interpolate(&rates, 1 << 30), 4.0);
}

#[test]
fn a_machine_has_positive_ceilings() {
    let machine = Machine::measure(0.0);
    assert!(machine.flops_per_sec > 1e8 && machine.bytes_per_sec > 1e7 && machine.exponentials_per_sec > 1e5);
    assert!(machine.reads.iter().chain(&machine.updates).all(|r| r.lines_per_sec > 1e5), "{machine:?}");
}
