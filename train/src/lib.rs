//! Learning of coupled dictionaries Dh, Dl (paper section 4.4, eq. 3).
