//! Algorithm 1, "fit Delaunay triangulation" (figure 6d): the neighbours of centres, and from them each centre's
//! lattice index.

use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation};

use crate::calibration::model::Lattice;

struct Vertex(Point2<f64>);

impl HasPosition for Vertex {
    type Scalar = f64;
    fn position(&self) -> Point2<f64> {
        self.0
    }
}

/// Edges of the Delaunay triangulation of the centres, as pairs of indices; empty where it does not exist (points that
/// are not finite, or coincide).
pub fn delaunay_edges(centres: &[[f64; 2]]) -> Vec<[usize; 2]> {
    // Coordinates too small for the triangulation's predicates count as zero.
    let tidy = |v: f64| if v.abs() < 1e-9 { 0.0 } else { v };
    let vertices: Vec<Vertex> = centres.iter().map(|c| Vertex(Point2::new(tidy(c[0]), tidy(c[1])))).collect();
    match DelaunayTriangulation::<Vertex>::bulk_load_stable(vertices) {
        Ok(t) if t.num_vertices() == centres.len() => {
            t.undirected_edges().map(|e| e.vertices().map(|v| v.fix().index())).collect()
        }
        _ => Vec::new(),
    }
}

/// Lattice index (i, j) of each centre, found by walking the triangulation from the centre nearest the lattice's
/// origin: each edge is one of the six (square: eight) steps between neighbours. Edges that are no such step, over a
/// missing lenslet or along the border, are not walked. `None` for centres that cannot be reached.
pub fn index_centres(centres: &[[f64; 2]], edges: &[[usize; 2]], lattice: &Lattice) -> Vec<Option<[i32; 2]>> {
    let mut index = vec![None; centres.len()];
    let mut neighbours: Vec<Vec<usize>> = vec![Vec::new(); centres.len()];
    for &[p, q] in edges {
        neighbours[p].push(q);
        neighbours[q].push(p);
    }
    let away = |c: &[f64; 2]| (c[0] - lattice.origin[0]).hypot(c[1] - lattice.origin[1]);
    let Some(start) = (0..centres.len()).min_by(|&p, &q| away(&centres[p]).total_cmp(&away(&centres[q]))) else {
        return index;
    };
    index[start] = Some([0, 0]);
    let mut queue = std::collections::VecDeque::from([(start, [0i32, 0])]);
    while let Some((p, [i, j])) = queue.pop_front() {
        for &q in &neighbours[p] {
            if index[q].is_some() {
                continue;
            }
            let step =
                [lattice.origin[0] + centres[q][0] - centres[p][0], lattice.origin[1] + centres[q][1] - centres[p][1]];
            let [fi, fj] = lattice.coordinates(step[0], step[1]);
            let (di, dj) = (fi.round(), fj.round());
            let off = (fi - di).hypot(fj - dj);
            if off < 0.25 && di.abs() <= 1.0 && dj.abs() <= 1.0 && (di, dj) != (0.0, 0.0) {
                let at = [i + di as i32, j + dj as i32];
                index[q] = Some(at);
                queue.push_back((q, at));
            }
        }
    }
    index
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::model::Grid;

    #[test]
    fn walking_gives_the_index_that_rounding_gives() {
        for grid in [Grid::HexRows, Grid::Square] {
            let b = if grid == Grid::Square { [-0.4, 10.0] } else { [4.6, 8.9] };
            let lattice = Lattice { grid, origin: [100.0, 100.0], a: [10.0, 0.4], b };
            let mut centres = Vec::new();
            let mut truth = Vec::new();
            for j in -8i32..=8 {
                for i in -8i32..=8 {
                    // Two lenslets are missing, the others are slightly displaced.
                    if (i, j) == (3, 2) || (i, j) == (-2, 0) {
                        continue;
                    }
                    let [x, y] = lattice.centre(i, j);
                    let wobble = f64::from((i * 7 + j * 13).rem_euclid(5)) * 0.1;
                    centres.push([x + wobble, y - wobble]);
                    truth.push([i, j]);
                }
            }
            let found = index_centres(&centres, &delaunay_edges(&centres), &lattice);
            let shift = found.iter().zip(&truth).find_map(|(f, t)| f.map(|f| [f[0] - t[0], f[1] - t[1]])).unwrap();
            assert_eq!(shift, [0, 0]);
            assert!(found.iter().zip(&truth).all(|(f, t)| *f == Some(*t)));
        }
        assert!(delaunay_edges(&[[f64::NAN, 0.0], [1.0, 1.0]]).is_empty());
        assert!(
            index_centres(&[], &[], &Lattice { grid: Grid::Square, origin: [0.0; 2], a: [1.0, 0.0], b: [0.0, 1.0] })
                .is_empty()
        );
    }
}
