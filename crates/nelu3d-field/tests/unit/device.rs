use nelu3d_field::device::{Choice, Device};

#[test]
fn choices_are_read_as_they_are_written() {
    for choice in [Choice::Auto, Choice::Cpu, Choice::Gpu, Choice::GpuAt(3)] {
        assert_eq!(choice.to_string().parse(), Ok(choice));
    }
    for text in ["", "gpu:", "gpu:-1", "GPU", "cuda"] {
        assert!(text.parse::<Choice>().unwrap_err().contains("nelu3d devices"), "{text}");
    }
}

#[test]
fn what_does_not_exist_is_named() {
    assert!(Device::open(Choice::Cpu).unwrap().is_cpu());
    let e = Device::open(Choice::GpuAt(999)).unwrap_err().to_string();
    assert!(e.contains("gpu:999") && e.contains("--device cpu"), "{e}");
}
