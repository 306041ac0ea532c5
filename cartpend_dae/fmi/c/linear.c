/* Dense linear equations, by Gauss with row exchange; matrices by columns, as CasADi writes them. */

/* Factor a (n, n) in place; return 0 if it is singular. */
static int lu_factor(double *a, int *pivots, int n) {
    for (int k = 0; k < n; k++) {
        int best = k;
        for (int i = k + 1; i < n; i++)
            if (fabs(a[i + k * n]) > fabs(a[best + k * n]))
                best = i;
        pivots[k] = best;
        if (!(fabs(a[best + k * n]) > 0) || !isfinite(a[best + k * n]))
            return 0;
        if (best != k)
            for (int j = 0; j < n; j++) {
                double kept = a[k + j * n];
                a[k + j * n] = a[best + j * n];
                a[best + j * n] = kept;
            }
        for (int i = k + 1; i < n; i++)
            a[i + k * n] /= a[k + k * n];
        for (int j = k + 1; j < n; j++) {
            double above = a[k + j * n];
            if (above != 0)
                for (int i = k + 1; i < n; i++)
                    a[i + j * n] -= a[i + k * n] * above;
        }
    }
    return 1;
}

/* Solve with a factored matrix, in place. */
static void lu_solve(const double *a, const int *pivots, double *b, int n) {
    for (int k = 0; k < n; k++) {
        double kept = b[pivots[k]];
        b[pivots[k]] = b[k];
        b[k] = kept;
        for (int i = k + 1; i < n; i++)
            b[i] -= a[i + k * n] * kept;
    }
    for (int k = n - 1; k >= 0; k--) {
        b[k] /= a[k + k * n];
        for (int i = 0; i < k; i++)
            b[i] -= a[i + k * n] * b[k];
    }
}

/* Solve with the transpose of a factored matrix, in place. */
static void lu_solve_transposed(const double *a, const int *pivots, double *b, int n) {
    for (int k = 0; k < n; k++) {
        for (int i = 0; i < k; i++)
            b[k] -= a[i + k * n] * b[i];
        b[k] /= a[k + k * n];
    }
    for (int k = n - 1; k >= 0; k--) {
        for (int i = k + 1; i < n; i++)
            b[k] -= a[i + k * n] * b[i];
        double kept = b[pivots[k]];
        b[pivots[k]] = b[k];
        b[k] = kept;
    }
}
