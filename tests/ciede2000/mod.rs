//! How different two colours look: CIE L*a*b* and the CIEDE2000 difference.
//!
//! Sharma, Wu and Dalal: "The CIEDE2000 color-difference formula: implementation notes, supplementary test data, and mathematical
//! observations" (2005), with the weights k_L = k_C = k_H = 1. A difference of 1 is about what a trained eye just sees.

use std::f64::consts::{PI, TAU};

/// White of sRGB (D65, 2 degrees), Y = 1.
const D65: [f64; 3] = [0.950_47, 1.0, 1.088_83];
/// Linear sRGB to X, Y, Z.
const XYZ: [[f64; 3]; 3] = [
    [0.412_456_4, 0.357_576_1, 0.180_437_5],
    [0.212_672_9, 0.715_152_2, 0.072_175],
    [0.019_333_9, 0.119_192, 0.950_304_1],
];

/// L*, a*, b* of a colour in linear sRGB, 1 = white.
pub fn lab(rgb: [f64; 3]) -> [f64; 3] {
    let f = |t: f64| {
        let knee: f64 = 6.0 / 29.0;
        if t > knee.powi(3) { t.cbrt() } else { t / (3.0 * knee * knee) + 4.0 / 29.0 }
    };
    let [x, y, z]: [f64; 3] = std::array::from_fn(|k| f((0..3).map(|c| XYZ[k][c] * rgb[c]).sum::<f64>() / D65[k]));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// CIEDE2000 difference of two colours in L*a*b*; 0 = the same.
pub fn delta_e_2000(first: [f64; 3], second: [f64; 3]) -> f64 {
    let chroma = |c: [f64; 3]| c[1].hypot(c[2]);
    let seventh = |c: f64| (c.powi(7) / (c.powi(7) + 25f64.powi(7))).sqrt();
    let g = 0.5 * (1.0 - seventh((chroma(first) + chroma(second)) / 2.0));
    let polar = |c: [f64; 3]| {
        let a = (1.0 + g) * c[1];
        (a.hypot(c[2]), if a == 0.0 && c[2] == 0.0 { 0.0 } else { c[2].atan2(a).rem_euclid(TAU) })
    };
    let ((c1, h1), (c2, h2)) = (polar(first), polar(second));
    let grey = c1 * c2 == 0.0;
    let mut dh = if grey { 0.0 } else { h2 - h1 };
    if dh > PI {
        dh -= TAU;
    } else if dh < -PI {
        dh += TAU;
    }
    let light = second[0] - first[0];
    let (dc, dh) = (c2 - c1, 2.0 * (c1 * c2).sqrt() * (dh / 2.0).sin());
    let (l, c) = ((first[0] + second[0]) / 2.0, (c1 + c2) / 2.0);
    let mut h = h1 + h2;
    if !grey {
        h /= 2.0;
        if (h1 - h2).abs() > PI {
            h += if h < PI { PI } else { -PI };
        }
    }
    let t = 1.0 - 0.17 * (h - PI / 6.0).cos() + 0.24 * (2.0 * h).cos() + 0.32 * (3.0 * h + PI / 30.0).cos()
        - 0.20 * (4.0 * h - 63f64.to_radians()).cos();
    let turn = 60f64.to_radians() * (-((h.to_degrees() - 275.0) / 25.0).powi(2)).exp();
    let s_l = 1.0 + 0.015 * (l - 50.0).powi(2) / (20.0 + (l - 50.0).powi(2)).sqrt();
    let (s_c, s_h) = (1.0 + 0.045 * c, 1.0 + 0.015 * c * t);
    let (dl, dc, dh) = (light / s_l, dc / s_c, dh / s_h);
    (dl * dl + dc * dc + dh * dh - 2.0 * seventh(c) * turn.sin() * dc * dh).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_pairs() {
        // From the supplementary data of the paper named above.
        let pairs = [
            ([50.0, 2.6772, -79.7751], [50.0, 0.0, -82.7485], 2.0425),
            ([50.0, 3.1571, -77.2803], [50.0, 0.0, -82.7485], 2.8615),
            ([50.0, 0.0, 0.0], [50.0, -1.0, 2.0], 2.3669),
            ([50.0, 2.5, 0.0], [73.0, 25.0, -18.0], 27.1492),
            ([50.0, 2.5, 0.0], [61.0, -5.0, 29.0], 22.8977),
            ([50.0, 2.5, 0.0], [56.0, -27.0, -3.0], 31.9030),
            ([50.0, 2.5, 0.0], [58.0, 24.0, 15.0], 19.4535),
            ([60.2574, -34.0099, 36.2677], [60.4626, -34.1751, 39.4387], 1.2644),
        ];
        for (a, b, expected) in pairs {
            assert!((delta_e_2000(a, b) - expected).abs() < 1e-4, "{a:?} {b:?}: {}", delta_e_2000(a, b));
            assert!((delta_e_2000(b, a) - expected).abs() < 1e-4);
            assert_eq!(delta_e_2000(a, a), 0.0);
        }
    }

    #[test]
    fn white_grey_and_red() {
        let near = |a: [f64; 3], b: [f64; 3], within: f64| (0..3).all(|k| (a[k] - b[k]).abs() < within);
        assert!(near(lab([1.0; 3]), [100.0, 0.0, 0.0], 1e-3));
        // 18.4187 % reflectance is L* 50, whatever the white.
        assert!(near(lab([0.184_187; 3]), [50.0, 0.0, 0.0], 1e-2));
        // sRGB red in CIE L*a*b* (D65), as many tables have it.
        assert!(near(lab([1.0, 0.0, 0.0]), [53.24, 80.09, 67.20], 0.02), "{:?}", lab([1.0, 0.0, 0.0]));
        assert!(near(lab([0.0; 3]), [0.0; 3], 1e-9));
    }
}
