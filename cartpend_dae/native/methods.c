/* One step of length h from (t_0, y_0) to y_1 by an explicit or an implicit method, its error and its dense output. */

/* Explicit: J. R. Dormand, P. J. Prince, A family of embedded Runge-Kutta formulae, J. Comput. Appl. Math. 6 (1980),
 * order 5 with an error of order 4; dense output of order 4: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary
 * Differential Equations I, 2nd ed., section II.6. */
static const double DP_C[7] = {0, 1.0 / 5, 3.0 / 10, 4.0 / 5, 8.0 / 9, 1, 1};
static const double DP_A[7][6] = {
    {0},
    {1.0 / 5},
    {3.0 / 40, 9.0 / 40},
    {44.0 / 45, -56.0 / 15, 32.0 / 9},
    {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
    {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
    {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84},
};
static const double DP_E[7] = {71.0 / 57600, 0, -71.0 / 16695, 71.0 / 1920, -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
static const double DP_D[7] = {-12715105075.0 / 11282082432, 0, 87487479700.0 / 32700410799,
                               -10690763975.0 / 1880347072, 701980252875.0 / 199316789632,
                               -1453857185.0 / 822651844, 69997945.0 / 29380423};

/* Implicit: G. Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks within the Julia
 * differential equations package, BIT 63 (2023): order 5 with an error of order 4, 8 stages, stiffly accurate, for
 * algebraic equations of index 1; in the form that needs no product with the Jacobian. Each of the last two stages
 * begins where the last increment ends. */
#define GAMMA 0.21193756319429014
static const double RO_C[8] = {0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1, 1, 1};
static const double RO_D[8] = {0.21193756319429014, -0.42387512638858027, -0.3384627126235924, 1.8046452872882734,
                               2.325825639765069, 0, 0, 0};
static const double RO_A[6][5] = {
    {0},
    {3.0},
    {2.849394379747939, 0.45842242204463923},
    {-6.954028509809101, 2.489845061869568, -10.358996098473584},
    {2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641},
    {-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946},
};
static const double RO_K[8][7] = {
    {0},
    {-14.155112264123755},
    {-17.97296035885952, -2.859693295451294},
    {147.12150275711716, -1.41221402718213, 71.68940251302358},
    {165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306},
    {24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471},
    {30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783, -19.097331116725623,
     -28.087943162872662},
    {37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047, -40.06618937091002,
     -54.66780262877968, -9.48861652309627},
};
static const double RO_H[3][8] = {
    {25.948786856663858, -2.5579724845846235, 10.433815404888879, -2.3679251022685204, 0.524948541321073,
     1.1241088310450404, 0.4272876194431874, -0.17202221070155493},
    {-9.91568850695171, -0.9689944594115154, 3.0438037242978453, -24.495224566215796, 20.176138334709044,
     15.98066361424651, -6.789040303419874, -6.710236069923372},
    {11.419903575922262, 2.8879645146136994, 72.92137995996029, 80.12511834622643, -52.072871366152654,
     -59.78993625266729, -0.15582684282751913, 4.883087185713722},
};

/* Add a multiple of a stage to n values. */
static void add(double *sum, double factor, const double *stage, int n)
{
    for (int r = 0; r < n; r++) sum[r] += factor * stage[r];
}

static void explicit_step(engine *e, double h)
{
    double y[ROOM(N_Y)];
    for (int i = 1; i < 7; i++) {
        memcpy(y, e->y_0, sizeof y);
        for (int j = 0; j < i; j++) add(y, h * DP_A[i][j], e->k[j], N_Y);
        rates_at(&e->now, e->t_0 + DP_C[i] * h, y, e->k[i]);
    }
    memcpy(e->y_1, y, sizeof(double) * N_Y);
    memset(e->error, 0, sizeof e->error);
    for (int i = 0; i < 7; i++) add(e->error, h * DP_E[i], e->k[i], N_Y);
}

static void explicit_dense(engine *e)
{
    for (int r = 0; r < N_Y; r++) {
        double whole = e->y_1[r] - e->y_0[r], last = 0;
        for (int i = 0; i < 7; i++) last += e->h * DP_D[i] * e->k[i][r];
        e->dense[0][r] = whole;
        e->dense[1][r] = e->h * e->k[0][r] - whole;
        e->dense[2][r] = whole - e->h * e->k[6][r] - e->dense[1][r] + last;
        e->dense[3][r] = -last;
    }
}

/* Replace a matrix (by columns) by its factors, rows exchanged; return whether it is regular. */
static int factorised(double *matrix, int *pivots, int n)
{
    for (int c = 0; c < n; c++) {
        double *column = matrix + c * n;
        int largest = c;
        for (int r = c + 1; r < n; r++)
            if (fabs(column[r]) > fabs(column[largest])) largest = r;
        pivots[c] = largest;
        if (!(fabs(column[largest]) > 0)) return 0;
        if (largest != c)
            for (int k = 0; k < n; k++) {
                double swap = matrix[k * n + c];
                matrix[k * n + c] = matrix[k * n + largest], matrix[k * n + largest] = swap;
            }
        column[c] = 1 / column[c];
        for (int r = c + 1; r < n; r++) column[r] *= column[c];
        for (int k = c + 1; k < n; k++) {
            double *other = matrix + k * n, factor = other[c];
            if (factor != 0)
                for (int r = c + 1; r < n; r++) other[r] -= factor * column[r];
        }
    }
    return 1;
}

static void solve(const double *factors, const int *pivots, double *right, int n)
{
    for (int c = 0; c < n; c++) {
        double swap = right[c];
        right[c] = right[pivots[c]], right[pivots[c]] = swap;
    }
    for (int c = 0; c < n; c++)
        for (int r = c + 1; r < n; r++) right[r] -= right[c] * factors[c * n + r];
    for (int c = n - 1; c >= 0; c--) {
        right[c] *= factors[c * n + c];
        for (int r = 0; r < c; r++) right[r] -= right[c] * factors[c * n + r];
    }
}

/* Replace a matrix (by columns) by its inverse; return whether it is regular.
 *
 * Gauss and Jordan: unknown c and the right-hand side of row `pivots[c]` change places. Rows stay where they are until
 * the end: a row exchanged just before its column is read as a whole would be waited for. */
static int inverted(double *matrix, int *pivots)
{
    double column[ROOM(N_Y)], found[ROOM(N_Y * N_Y)];
    int is_used[ROOM(N_Y)] = {0};
    for (int k = 0; k < N_Y; k++) {
        double *own = matrix + k * N_Y;
        int p = -1;
        for (int r = 0; r < N_Y; r++)
            if (!is_used[r] && (p < 0 || fabs(own[r]) > fabs(own[p]))) p = r;
        if (!(fabs(own[p]) > 0)) return 0;
        double inverse = 1 / own[p];
        pivots[k] = p, is_used[p] = 1;
        memcpy(column, own, sizeof column);
        column[p] = 0;
        for (int c = 0; c < N_Y; c++) {
            double *other = matrix + c * N_Y, factor = other[p] * inverse;
            if (c == k || factor == 0) continue;
            add(other, -factor, column, N_Y);
            other[p] = factor;
        }
        for (int r = 0; r < N_Y; r++) own[r] = -inverse * column[r];
        own[p] = inverse;
    }
    for (int c = 0; c < N_Y; c++)
        for (int k = 0; k < N_Y; k++) found[pivots[c] * N_Y + k] = matrix[c * N_Y + pivots[k]];
    memcpy(matrix, found, N_Y * N_Y * sizeof *found);
    return 1;
}

/* Make the matrix of an implicit step ready for `solve_step`; return whether it is regular. */
static int prepared(engine *e, double h)
{
    for (int i = 0; i < N_Y * N_Y; i++) e->matrix[i] = -e->jacobian[i];
    for (int r = 0; r < N_X; r++) e->matrix[r * N_Y + r] += 1 / (h * GAMMA);
    return IS_INVERTED ? inverted(e->matrix, e->pivots) : factorised(e->matrix, e->pivots, N_Y);
}

/* Replace a right-hand side by the solution with the matrix of the step. */
static void solve_step(const engine *e, double *right)
{
#if IS_INVERTED
    double given[ROOM(N_Y)];
    memcpy(given, right, sizeof given);
    for (int r = 0; r < N_Y; r++) {
        double sum = 0;
        for (int c = 0; c < N_Y; c++) sum += e->matrix[c * N_Y + r] * given[c];
        right[r] = sum;
    }
#else
    solve(e->matrix, e->pivots, right, N_Y);
#endif
}

static void implicit_step(engine *e, double h)
{
    double y[ROOM(N_Y)];
    if (!prepared(e, h)) {
        for (int r = 0; r < N_Y; r++) e->error[r] = NAN;
        return;
    }
    const double per_h = 1 / h;
    memcpy(y, e->y_0, sizeof y);
    for (int i = 0; i < N_STAGES; i++) {
        double *k = e->k[i];
        for (int r = 0; r < N_Y; r++) {
            double sum = i < 6 ? e->y_0[r] : y[r] + e->k[i - 1][r];
            if (i < 6)
                for (int j = 0; j < i; j++) sum += RO_A[i][j] * e->k[j][r];
            y[r] = sum;
        }
        rates_at(&e->now, e->t_0 + RO_C[i] * h, y, k);
        for (int r = 0; r < N_Y; r++) {
            double sum = 0;
            for (int j = 0; j < i; j++) sum += RO_K[i][j] * e->k[j][r];
            k[r] += h * RO_D[i] * e->in_time[r] + (r < N_X ? sum * per_h : 0);
        }
        solve_step(e, k);
    }
    for (int r = 0; r < N_Y; r++) e->error[r] = e->k[7][r], e->y_1[r] = y[r] + e->k[7][r];
}

static void implicit_dense(engine *e)
{
    for (int r = 0; r < N_Y; r++) {
        e->dense[0][r] = e->y_1[r] - e->y_0[r];
        for (int row = 0; row < 3; row++) {
            double sum = 0;
            for (int i = 0; i < N_STAGES; i++) sum += RO_H[row][i] * e->k[i][r];
            e->dense[row + 1][r] = sum;
        }
    }
}

/* Prepare the steps from where the run stands. */
static void begin_step(engine *e)
{
    if (e->set.method == EXPLICIT) { /* the last stage of a step is the first of the next one */
        if (e->is_stepped)
            memcpy(e->k[0], e->k[6], sizeof e->k[0]);
        else
            rates_at(&e->now, e->now.t, e->now.y, e->k[0]);
    } else
        slopes_at(&e->now, e->now.t, e->now.y, e->jacobian, e->in_time);
    e->t_0 = e->now.t;
    memcpy(e->y_0, e->now.y, sizeof e->y_0);
}

static void try_step(engine *e, double h)
{
    e->h = h;
    if (e->set.method == EXPLICIT)
        explicit_step(e, h);
    else
        implicit_step(e, h);
}

static void make_dense(engine *e)
{
    e->is_rough = -1;
    if (e->set.method == EXPLICIT)
        explicit_dense(e);
    else
        implicit_dense(e);
}

/* Give states and algebraic variables at a part 0 <= share <= 1 of the last step. */
static void inside(const engine *e, double share, double *y)
{
    for (int r = 0; r < N_Y; r++) {
        double high = e->dense[2][r] + share * e->dense[3][r];
        y[r] = e->y_0[r] + share * (e->dense[0][r] + (1 - share) * (e->dense[1][r] + share * high));
    }
}

/* Return the norm of a change of the last step over the tolerance. */
static double weighed(const engine *e, const double *change)
{
    double sum = 0;
    for (int r = 0; r < N_Y; r++) {
        double weight = e->set.atol + e->set.rtol * fmax(fabs(e->y_0[r]), fabs(e->y_1[r]));
        sum += change[r] * change[r] / (weight * weight);
    }
    return N_Y ? sqrt(sum / N_Y) : 0;
}

/* Give by how much the dense output at a part of the last step misses its own equations.
 *
 * The matrix of the step turns the defect of the rates into one of the values: of what is stiff, and of the algebraic
 * variables, this is the whole error, which the order of a dense output says nothing about. */
static void defect(engine *e, double share, const double *y, double *change)
{
    double t = e->t_0 + share * e->h;
    /* an event at the end of the step may have changed the memory */
    EVALUATE(model_rates, given(arguments, &e->now, &t, y), arguments[2] = e->m_0, results[0] = change);
    for (int r = 0; r < N_X; r++) {
        double a = e->dense[1][r], b = e->dense[2][r], c = e->dense[3][r];
        double slope = e->dense[0][r] + (1 - 2 * share) * a + share * (2 - 3 * share) * b
                       + share * share * (3 - 4 * share) * c;
        change[r] -= slope / e->h;
    }
    solve_step(e, change);
}

/* Give states and algebraic variables at a part of the last step for output; where the dense output of the implicit
 * method is rough in the middle of the step, it is corrected by its defect. */
static void output(engine *e, double share, double *y)
{
    double change[ROOM(N_Y)];
    inside(e, share, y);
    if (e->set.method == EXPLICIT) return;
    if (e->is_rough < 0) {
        double middle[ROOM(N_Y)];
        inside(e, 0.5, middle);
        defect(e, 0.5, middle, change);
        e->is_rough = weighed(e, change) > 1;
    }
    if (!e->is_rough) return;
    defect(e, share, y, change);
    for (int r = 0; r < N_Y; r++) y[r] += change[r];
}
