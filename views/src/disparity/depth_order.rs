//! Which end of a disparity map is the near one.

/// Whether nearer surfaces have the smaller or the larger disparity.
///
/// With views numbered as this project does (u to the right, v down, the scene point at x of the middle view at
/// x + D·u), nearer is smaller; light fields whose views are numbered against the camera's movement have it the other
/// way round.
///
/// ```
/// use lenslet_views::disparity::DepthOrder;
///
/// assert_eq!(DepthOrder::default().sign(), -1.0);
/// assert!(DepthOrder::NearerIsSmaller.is_in_front(-2.0, 1.0));
/// assert!(!DepthOrder::NearerIsLarger.is_in_front(-2.0, 1.0));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DepthOrder {
    /// The usual order of views.
    #[default]
    NearerIsSmaller,
    /// Views numbered the other way round.
    NearerIsLarger,
}

impl DepthOrder {
    /// −1 where nearer is smaller, +1 where nearer is larger: `sign · disparity` grows towards the viewer.
    #[inline]
    #[must_use]
    pub fn sign(self) -> f32 {
        match self {
            DepthOrder::NearerIsSmaller => -1.0,
            DepthOrder::NearerIsLarger => 1.0,
        }
    }

    /// Whether a surface of disparity `a` hides one of disparity `b`; never when either is NaN.
    #[inline]
    #[must_use]
    pub fn is_in_front(self, a: f32, b: f32) -> bool {
        self.sign() * a > self.sign() * b
    }

    /// The disparity of the surface further behind; the other one where one is NaN.
    #[inline]
    #[must_use]
    pub fn behind(self, a: f32, b: f32) -> f32 {
        match self {
            DepthOrder::NearerIsSmaller => a.max(b),
            DepthOrder::NearerIsLarger => a.min(b),
        }
    }
}
