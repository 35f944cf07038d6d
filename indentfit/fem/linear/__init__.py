"""The linear solves of Newton's iteration: few factorisations, many uses of each.

The tangent of a nearly incompressible body in contact is K = A + kappa Bᵀ B + C: its isochoric part, the dilatation B of each
element, and the contact. GMRES (`krylov`) solves the form with the pressures as unknowns, [A + C, Bᵀ; B, -1/kappa],
preconditioned with the factor of an earlier tangent (`solver`). A factor is a direct one, taken apart so that what changes
most never makes it useless (`direct`, made by `pardiso` or `superlu`), or a multigrid hierarchy (`multigrid`).
"""
