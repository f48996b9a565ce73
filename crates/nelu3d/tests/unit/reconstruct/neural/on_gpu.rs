use nelu3d::progress::Progress;
use nelu3d::reconstruct::neural::on_gpu::{DeviceScene, Follower, TrainedParts};
use nelu3d::reconstruct::neural::start::Start;
use nelu3d::reconstruct::neural::{Ambient, AmbientField, config};
use nelu3d::reconstruct::{Context, Failure, Observer, Stage};
use nelu3d_field::device::Choice;
use nelu3d_field::encoding::hash_grid::HashGridConfig;
use nelu3d_field::gpu::{AmbientUse, Gpu, RayScene, ScenePixel, TrainingReport};
use nelu3d_field::lattice::{Lattice, ProjectiveFrame};
use nelu3d_field::occupancy::{OccupancyConfig, OccupancyGrid};
use std::sync::Arc;

/// The last iteration that was observed.
struct LastIteration(usize);

impl Observer for LastIteration {
    fn surface(&mut self, _: Stage, iteration: usize, _: &[f32]) {
        self.0 = iteration;
    }
}

/// Pulls the plug at the second report.
struct Plug {
    gpu: Arc<Gpu>,
    reports: Vec<usize>,
    fetched: Vec<(usize, usize, bool)>,
}

impl Follower for Plug {
    fn report(&mut self, report: &TrainingReport, done: usize) -> bool {
        self.reports.push(done);
        if done > 1 {
            self.gpu.destroy();
        }
        report.losses.total.is_finite()
    }

    fn fetched(&mut self, _: &TrainedParts<'_>, done: usize, n_rays: usize, stopping: bool) -> Result<(), Failure> {
        self.fetched.push((done, n_rays, stopping));
        Ok(())
    }

    fn render_depth(&self, _: &TrainedParts<'_>) -> Vec<f32> {
        Vec::new()
    }
}

/// A device that is lost during training leaves the state of the last checkpoint.
#[test]
fn a_lost_gpu_hands_over_to_the_cpu() {
    let Ok(gpu) = Gpu::open_anew(Choice::Gpu) else {
        assert!(std::env::var_os("NELU3D_REQUIRE_GPU").is_none(), "no GPU, and NELU3D_REQUIRE_GPU is set");
        eprintln!("SKIPPED: training on a GPU: no GPU and no software driver");
        return;
    };
    let mut surface_config = config::surface_config(Default::default(), 300);
    config::hasten(&mut surface_config, 300);
    surface_config.field.encoding = HashGridConfig {
        n_levels: 3,
        log2_hashmap_size: 10,
        finest_resolution: [40; 3],
        ..surface_config.field.encoding
    };
    surface_config.field.width = 8;
    let mut surface = Start::Plane.surface(surface_config, 1);
    let before = surface.field().params().to_vec();
    let mut ambient = AmbientField::new(Ambient::Bounded, 1, 300, 1);
    let mut occupancy =
        OccupancyGrid::new(OccupancyConfig { resolution: 8, ..config::occupancy_config(300) }, |_| true);
    let nodes = vec![0.5; 4 * 4 * 4 * 2];
    let pixel = ScenePixel { dir: [0.0, 0.0, 1.0], near: 1.0, place: [0.5; 2], far: 2.0, mask: 1.0 };
    let scene = DeviceScene {
        pixels: vec![pixel; 4],
        origin: [0.5, 0.5, -1.0],
        measured: vec![0.6; 8],
        white: vec![0.9; 4],
        n_channels: 1,
        lattice: Lattice { nodes: &nodes, cells: [1; 3], k: 2 },
        affine: RayScene::CUBE,
        frame: ProjectiveFrame::UNIT,
        ambient: AmbientUse::Fraction,
        n_samples: 512,
        step: 0.05,
        half_step: 0.01,
        anneal_steps: 0,
        seed: 1,
    };
    let mut parts = TrainedParts { surface: &mut surface, ambient: &mut ambient, occupancy: &mut occupancy };
    let mut plug = Plug { gpu: gpu.clone(), reports: Vec::new(), fetched: Vec::new() };
    let (progress, mut observer) = (Progress::none(), LastIteration(0));
    let mut cx = Context::new(&progress, Choice::Cpu).unwrap().with_observer(Some(&mut observer));
    let (done, n_rays) = scene.train(&gpu, &mut parts, (0, 16), 300, &mut cx, &mut plug).unwrap();
    drop(cx);
    // Observed after 100 iterations, lost after 101.
    assert_eq!((plug.reports.as_slice(), observer.0, done), ([1, 101].as_slice(), 100, 100));
    assert_eq!(plug.fetched.last(), Some(&(100, n_rays, false)));
    assert!(n_rays >= 16);
    assert_eq!(surface.field().n_steps(), 100);
    assert!(surface.field().params() != before && surface.field().params().iter().all(|p| p.is_finite()));
}
