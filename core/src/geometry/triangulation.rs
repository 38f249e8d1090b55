//! The Delaunay triangulation of lenslet centres (paper section 3.2, end of Algorithm 1), without its border slivers.

use spade::{DelaunayTriangulation, HasPosition, InsertionError, Point2, Triangulation as _};

/// Centres that span no triangulation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TriangulationError {
    /// A coordinate is NaN, infinite or 1e9 and more.
    #[error("centre {0} is not a finite position near the sensor")]
    NotFinite(usize),
    /// Two centres are at the same position.
    #[error("two of the {0} centres are at the same position")]
    Duplicate(usize),
    /// The centres span no area.
    #[error("{0} centres span no triangle: at least three that are not on one line are needed")]
    Flat(usize),
    /// More centres than indices of 32 bits reach.
    #[error("{0} centres are more than a triangulation holds")]
    TooMany(usize),
}

use TriangulationError as Error;

/// Triangles over centres. Vertices are indices into the centres they were made from.
#[derive(Debug, Clone, PartialEq)]
pub struct Triangulation {
    /// Vertices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Edges of the outline, each belonging to one triangle only.
    pub outline: Vec<[u32; 2]>,
}

struct Vertex(Point2<f64>);

impl HasPosition for Vertex {
    type Scalar = f64;
    fn position(&self) -> Point2<f64> {
        self.0
    }
}

/// A border triangle is removed when its angle opposite the outline is wider than 135° (this is that angle's cosine).
///
/// The hull of a slightly turned lattice has edges hundreds of pitches long where a row leaves the sensor; the slivers
/// under them would mix lenslets far apart. The notches between rows, 120° wide, are kept.
/// Source: chosen between the 120° of the notches and the 180° of the slivers.
const SLIVER: f64 = -std::f64::consts::FRAC_1_SQRT_2;

/// Triangulates `centres`; slivers at the border are left out, so the outline need not be convex.
///
/// # Errors
/// Fewer than three centres or all on one line, two at one place, a coordinate that is not finite.
///
/// ```
/// use lenslet_core::geometry::triangulate;
/// let mesh = triangulate(&[[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [4.0, 4.1]])?;
/// assert_eq!((mesh.triangles.len(), mesh.outline.len()), (2, 4));
/// assert!(triangulate(&[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]).is_err());
/// # Ok::<(), lenslet_core::geometry::TriangulationError>(())
/// ```
pub fn triangulate(centres: &[[f64; 2]]) -> Result<Triangulation, Error> {
    if let Some(k) = centres.iter().position(|c| !c.iter().all(|v| v.abs() < 1e9)) {
        return Err(Error::NotFinite(k));
    }
    if u32::try_from(centres.len()).is_err() {
        return Err(Error::TooMany(centres.len()));
    }
    // Coordinates too small for the triangulation's predicates count as zero.
    let tidy = |v: f64| if v.abs() < 1e-30 { 0.0 } else { v };
    let vertices = centres.iter().map(|c| Vertex(Point2::new(tidy(c[0]), tidy(c[1])))).collect();
    let mesh = DelaunayTriangulation::<Vertex>::bulk_load_stable(vertices).map_err(|e| match e {
        InsertionError::NAN | InsertionError::TooLarge | InsertionError::TooSmall => Error::NotFinite(0),
    })?;
    if mesh.num_vertices() != centres.len() {
        return Err(Error::Duplicate(centres.len()));
    }
    let triangles: Vec<[u32; 3]> = mesh.inner_faces().map(|f| f.vertices().map(|v| v.fix().index() as u32)).collect();
    if triangles.is_empty() {
        return Err(Error::Flat(centres.len()));
    }
    Ok(without_slivers(centres, triangles))
}

/// Edge k of a triangle lies opposite its vertex k.
fn edge(t: [u32; 3], k: usize) -> [u32; 2] {
    let (a, b) = (t[(k + 1) % 3], t[(k + 2) % 3]);
    [a.min(b), a.max(b)]
}

fn without_slivers(centres: &[[f64; 2]], triangles: Vec<[u32; 3]>) -> Triangulation {
    // Every edge with its triangle, sorted so that the two sides of an inner edge are adjacent.
    let mut sides: Vec<([u32; 2], u32, u8)> = Vec::with_capacity(triangles.len() * 3);
    for (n, &t) in triangles.iter().enumerate() {
        for k in 0..3 {
            sides.push((edge(t, k), n as u32, k as u8));
        }
    }
    sides.sort_unstable();
    let mut neighbour = vec![[u32::MAX; 3]; triangles.len()];
    let mut open: Vec<(u32, u8)> = Vec::new();
    let mut k = 0;
    while k < sides.len() {
        let (e, n, side) = sides[k];
        match sides.get(k + 1) {
            Some(&(f, m, other)) if e == f => {
                neighbour[n as usize][side as usize] = m;
                neighbour[m as usize][other as usize] = n;
                k += 2;
            }
            _ => {
                open.push((n, side));
                k += 1;
            }
        }
    }
    let sliver = |n: u32, side: u8| {
        let t = triangles[n as usize];
        let p = centres[t[side as usize] as usize];
        let [a, b] = edge(t, side as usize).map(|v| centres[v as usize]);
        let (u, v) = ([a[0] - p[0], a[1] - p[1]], [b[0] - p[0], b[1] - p[1]]);
        (u[0] * v[0] + u[1] * v[1]) < SLIVER * u[0].hypot(u[1]) * v[0].hypot(v[1])
    };
    let mut gone = vec![false; triangles.len()];
    let mut left = triangles.len();
    let mut outline = Vec::new();
    while let Some((n, side)) = open.pop() {
        if gone[n as usize] {
            continue;
        }
        if left > 1 && sliver(n, side) {
            gone[n as usize] = true;
            left -= 1;
            for other in 0..3u8 {
                let m = neighbour[n as usize][other as usize];
                if other != side && m != u32::MAX && !gone[m as usize] {
                    let back = (0..3).find(|&b| neighbour[m as usize][b] == n).unwrap_or(0);
                    open.push((m, back as u8));
                }
            }
        } else {
            outline.push((n, side));
        }
    }
    // The triangle of an edge may have been removed from another side after the edge was accepted.
    let mut outline: Vec<[u32; 2]> = outline
        .into_iter()
        .filter(|&(n, _)| !gone[n as usize])
        .map(|(n, side)| edge(triangles[n as usize], side as usize))
        .collect();
    outline.sort_unstable();
    let triangles = triangles.into_iter().zip(gone).filter_map(|(t, gone)| (!gone).then_some(t)).collect();
    Triangulation { triangles, outline }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Lattice, Size};

    #[test]
    fn a_lattice_gives_its_own_triangles_and_no_slivers() {
        let placed = Lattice::hexagonal(10.0, 0.003, 1.0004, [2.3, 4.1]).points_within(Size::new(400, 300), 0.0);
        let mesh = triangulate(&placed.centres).unwrap();
        for t in &mesh.triangles {
            for k in 0..3 {
                let [a, b] = edge(*t, k).map(|v| placed.centres[v as usize]);
                // Neighbours, or the notch between two rows.
                assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 17.5);
            }
        }
        // Euler: V − E + F = 1 with 3F = 2E − outline.
        let (v, f, o) = (placed.centres.len(), mesh.triangles.len(), mesh.outline.len());
        assert_eq!(3 * f + o, 2 * (v + f - 1));
    }

    #[test]
    fn bad_centres_are_errors() {
        assert!(matches!(triangulate(&[]), Err(Error::Flat(0))));
        assert!(matches!(triangulate(&[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]), Err(Error::Flat(3))));
        assert!(matches!(triangulate(&[[0.0, 0.0], [1.0, f64::NAN], [2.0, 2.0]]), Err(Error::NotFinite(1))));
        assert!(matches!(triangulate(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 0.0]]), Err(Error::Duplicate(4))));
        assert!(triangulate(&[[0.0, 1e-320], [1.0, 0.0], [0.0, 1.0]]).is_ok());
    }
}
