//! PSNR, SSIM, edge measures.
