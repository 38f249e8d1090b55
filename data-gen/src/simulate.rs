//! A scene of textured layers seen by a simulated lenslet camera: captures, white images, truth.
