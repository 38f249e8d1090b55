//! Dense linear algebra, in one place, over [faer](https://docs.rs/faer) and ndarray.
//!
//! | what | where |
//! |---|---|
//! | products, Gram matrices | [`product`], [`product_into_columns`], [`gram`] |
//! | A·X = B with A symmetric and positive definite | [`Cholesky`], [`solve_ridge`] |
//! | min ‖XW − Y‖² + ρ‖W‖² | [`least_squares`] |
//! | singular values, eigenvectors (principal components) | [`thin_svd`], [`symmetric_eigen`] |
//! | small systems without structure | [`solve_small`] and its two variants for many right-hand sides |
//!
//! Threads are an argument ([`Par`]) of the products alone; the decompositions run on the calling thread. Use
//! [`Par::Seq`] inside parallel loops and wherever results must not depend on the number of threads: the last bits of a
//! product may. All results may differ in the last bits between processors: faer chooses the vector width at run time.

mod cholesky;
mod decomposition;
mod elimination;
mod error;
mod matrix;
mod product;

pub use cholesky::{Cholesky, least_squares, solve_ridge};
pub use decomposition::{Eigen, Svd, symmetric_eigen, thin_svd};
pub use elimination::{gauss_jordan, gauss_with_back_substitution, solve_small};
pub use error::Error;
pub use faer::Par;
pub use matrix::Real;
pub use product::{gram, product, product_into_columns};
