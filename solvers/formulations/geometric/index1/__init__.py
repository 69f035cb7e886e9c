"""Index 1 without the saddle: S = A M^-1 A^T joint by joint, its Cholesky factor, accelerations, projections."""
