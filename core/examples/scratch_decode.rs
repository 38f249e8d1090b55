use lenslet_core::{calibration::*, container::*, decode, progress::Silent};
use ndarray::{Array1, Array2, Array3};
use std::path::Path;
pub fn load(dir: &str) -> (Capture, Calibration) {
    let rd = |n: &str| -> Array2<u16> { ndarray_npy::read_npy(Path::new(dir).join(n)).unwrap() };
    let (scene, white) = (rd("scene.npy"), rd("white.npy"));
    let c: Array2<f64> = ndarray_npy::read_npy(Path::new(dir).join("centers.npy")).unwrap();
    let (h, w) = scene.dim();
    let resp = [0.7630647f32, 1.0, 1.0, 0.7447674];
    let cfa = Cfa::Bggr;
    let mut wf: Vec<f32> = white
        .iter()
        .enumerate()
        .map(|(k, &v)| ((v as f32 - 168.0) / 3927.0 / resp[cfa.plane(k % w, k / w)]).max(0.0))
        .collect();
    let mx = {
        let mut s = wf.clone();
        s.sort_unstable_by(f32::total_cmp);
        s[s.len() * 999 / 1000]
    };
    wf.iter_mut().for_each(|v| *v /= mx);
    let lenslets = c
        .rows()
        .into_iter()
        .map(|r| Lenslet { i: (r[3] - (r[2] / 2.0).floor()) as i32, j: r[2] as i32, x: r[0], y: r[1], trust: 1.0 })
        .collect();
    let (p, rot) = (10.0f64, 0.003f64);
    let lattice = Lattice { grid: Grid::HexRows, origin: [0.0; 2], a: [p * rot.cos(), p * rot.sin()], b: [0.0, 1.0] };
    let cal = Calibration {
        width: w,
        height: h,
        lattice,
        lenslets,
        quality: Default::default(),
        vignetting: Some(Vignetting {
            width: w,
            height: h,
            white: wf.iter().map(|v| (v * 32768.0).round().clamp(0.0, 65535.0) as u16).collect(),
        }),
        origin: Default::default(),
    };
    let cap = Capture {
        mosaic: RawMosaic { width: w, height: h, data: scene.iter().copied().collect() },
        cfa,
        levels: Levels { black: [168.0; 4], white: [4095.0; 4] },
        colour: ColourFacts {
            white_balance: [1.0 / resp[0], 1.0, 1.0, 1.0 / resp[3]],
            ccm: [1., 0., 0., 0., 1., 0., 0., 0., 1.],
            gamma: None,
        },
        camera: Default::default(),
        mla: None,
        source_sha256: String::new(),
        white: None,
        warnings: vec![],
    };
    (cap, cal)
}
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let (cap, cal) = load(&a[1]);
    let t = std::time::Instant::now();
    let kind = match a[3].as_str() {
        "bilinear" => decode::Demosaic::Bilinear,
        _ => decode::Demosaic::Malvar,
    };
    let mut steps = decode::default_steps();
    for s in &mut steps {
        if let decode::Step::Demosaic(k) = s {
            *k = kind;
        }
    }
    let s = decode::samples(&cap, &cal, &decode::Options { steps, ..Default::default() }, &Silent).unwrap();
    eprintln!("samples {:?}", t.elapsed());
    ndarray_npy::write_npy(format!("{}/values.npy", a[2]), &s.values).unwrap();
    let _: (Option<Array1<f32>>, Option<Array3<f32>>) = (None, None);
    let idx = Array2::from_shape_fn((s.index.len(), 2), |(k, c)| s.index[k][c]);
    ndarray_npy::write_npy(format!("{}/index.npy", a[2]), &idx).unwrap();
    let ce = Array2::from_shape_fn((s.index.len(), 2), |(k, c)| s.centres[k][c]);
    ndarray_npy::write_npy(format!("{}/centres.npy", a[2]), &ce).unwrap();
    let t = std::time::Instant::now();
    let w = lenslet_core::sampling::Cubic::new(&s.centres, s.sensor, (1080, 1080)).unwrap();
    eprintln!("cubic table {:?}", t.elapsed());
    for v in [(3usize, 3usize)] {
        let t = std::time::Instant::now();
        let img = w.apply(s.values.index_axis(ndarray::Axis(0), v.0 * 7 + v.1)).unwrap();
        eprintln!("cubic apply {:?}", t.elapsed());
        ndarray_npy::write_npy(format!("{}/cubic_{}_{}.npy", a[2], v.0, v.1), &img).unwrap();
    }
    for v in [(0usize, 0usize), (0, 3), (3, 3), (3, 6), (6, 6)] {
        let t = std::time::Instant::now();
        let w = lenslet_core::sampling::Weights::new(&s.centres, s.sensor, (1080, 1080)).unwrap();
        let t1 = t.elapsed();
        let img = w.apply(s.values.index_axis(ndarray::Axis(0), v.0 * 7 + v.1)).unwrap();
        eprintln!("table {t1:?} apply {:?}", t.elapsed() - t1);
        ndarray_npy::write_npy(format!("{}/bary_{}_{}.npy", a[2], v.0, v.1), &img).unwrap();
    }
}
