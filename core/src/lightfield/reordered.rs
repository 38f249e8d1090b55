//! Light fields read in another order than they are stored in.

use ndarray::Array3;

use super::error::Error;
use super::meta::Meta;
use super::view_io::{Numbering, ViewSource};
use super::view_order::ReadOrder;

/// A light field whose views are stored in another order.
pub(super) struct Reordered {
    source: Box<dyn ViewSource>,
    read_order: ReadOrder,
    meta: Meta,
    notes: Vec<String>,
}

impl Reordered {
    /// Reads `source`, which is in the order `read_order`, in this project's; `notes` come after its own.
    pub(super) fn new(source: Box<dyn ViewSource>, read_order: ReadOrder, notes: Vec<String>) -> Self {
        let mut meta = source.meta().clone();
        let [rows, columns] = read_order.order.stored_views(meta.views);
        let weights = meta.weights.take().map(|stored| {
            let weight = |k: usize| {
                let [a, b] = read_order.order.stored_place([k / columns, k % columns], [rows, columns]);
                stored[a * meta.views[1] + b]
            };
            (0..stored.len()).map(weight).collect()
        });
        (meta.views, meta.weights) = ([rows, columns], weights);
        let notes = source.notes().iter().cloned().chain(notes).collect();
        Reordered { source, read_order, meta, notes }
    }

    fn stored(&self, v: usize, u: usize) -> Result<[usize; 2], Error> {
        self.meta.check_place(v, u)?;
        Ok(self.read_order.order.stored_place([v, u], self.meta.views))
    }
}

impl ViewSource for Reordered {
    fn meta(&self) -> &Meta {
        &self.meta
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn numbering(&self) -> Numbering {
        self.source.numbering()
    }

    fn order(&self) -> Option<ReadOrder> {
        Some(self.read_order)
    }

    fn stored_bytes(&self) -> Option<u64> {
        self.source.stored_bytes()
    }

    fn is_absent(&self, v: usize, u: usize) -> Result<bool, Error> {
        let [a, b] = self.stored(v, u)?;
        self.source.is_absent(a, b)
    }

    fn read(&self, v: usize, u: usize) -> Result<Array3<f32>, Error> {
        let [a, b] = self.stored(v, u)?;
        self.source.read(a, b).map_err(|e| match e {
            Error::Absent { path, .. } => Error::Absent { path, row: v, column: u },
            other => other,
        })
    }
}
