"""What makes arrays a certificate of a curve, before anything is computed from them."""

from __future__ import annotations

import numpy as np

from planner.certificate import Certificate, CertificateSection
from planner.errors import InputError
from planner.geometry.curve import Curve
from planner.verify.sizes import ON_KNOT


def require_valid(certificate: Certificate, curve: Curve) -> None:
    """Raise InputError unless the certificate is one of this curve: its arrays fit, and its sections cover it."""
    if certificate.fingerprint != curve.fingerprint:
        raise InputError(
            f"the certificate is for another curve (hash {certificate.fingerprint[:12]}), not for {curve.name} "
            f"({curve.fingerprint[:12]}); give the curve, and the scale and tolerance, it was made with"
        )
    require_shapes(certificate)
    u0, u1 = curve.domain
    near = ON_KNOT * (u1 - u0)
    ends = [(float(s.u[0, 0]), float(s.u[0, -1])) for s in certificate.sections]
    meet = [u0, *(end for _, end in ends)], [*(start for start, _ in ends), u1]
    for before, after in zip(*meet, strict=True):
        if abs(before - after) > near:
            raise InputError(f"the certificate leaves out the curve between u = {before!r} and {after!r}")


def require_shapes(certificate: Certificate) -> None:
    """Raise InputError unless every array has its shape and finite values, and the ends make sense."""
    for names in (certificate.jerk_names, certificate.acceleration_names):
        if len(set(names)) != len(names):
            raise InputError(f"the certificate names a limit twice: {', '.join(names)}")
    if not certificate.sections:
        raise InputError("the certificate has no section")
    if not np.isfinite(certificate.bound):
        raise InputError(f"bound = {certificate.bound!r} of the certificate must be finite")
    last = len(certificate.sections) - 1
    for k, section in enumerate(certificate.sections):
        _require_arrays(section, certificate, f"section {k} of the certificate")
        for name, feed, outer in (("start", section.start_feed, k == 0), ("end", section.end_feed, k == last)):
            free = certificate.periodic and outer
            if not (np.isnan(feed) if free else np.isfinite(feed) and feed >= 0.0 and (outer or feed == 0.0)):
                allowed = "nan, free" if free else "0, a stop" if not outer else ">= 0 and finite"
                raise InputError(f"section {k} of the certificate: {name}_feed = {feed!r} must be {allowed}")
        if not np.isnan(section.start_acceleration) and not (
            section.start_feed > 0.0 and np.isfinite(section.start_acceleration)
        ):
            raise InputError(
                f"section {k} of the certificate: start_acceleration = {section.start_acceleration!r} must be nan, or "
                "finite at a start with a feed"
            )


def _require_arrays(section: CertificateSection, certificate: Certificate, where: str) -> None:
    n = section.sigma.size  # of a sigma that is no row, too: its shape is refused below
    shapes = {
        "sigma": (n,),
        "u": (3, n),
        "jerk": (len(certificate.jerk_names), n + 1),
        "acceleration": (len(certificate.acceleration_names), n),
    }
    for name, shape in shapes.items():
        values = getattr(section, name)
        if values.shape != shape or values.dtype != np.float64 or n < 2:
            raise InputError(
                f"{where}: {name} is {values.dtype} of shape {values.shape}; must be float64 of shape {shape}, n > 1"
            )
        if not np.isfinite(values).all():
            raise InputError(f"{where}: {name} has a value that is not finite")
    step, u = np.diff(section.sigma), section.u[0]
    bad = np.flatnonzero(step < 0.0)
    if bad.size:
        raise InputError(
            f"{where}: sigma[{bad[0] + 1}] = {float(section.sigma[bad[0] + 1])!r} is less than the one before"
        )
    double = np.flatnonzero(step == 0.0)
    if double.size and (double[0] == 0 or double[-1] == n - 2 or (np.diff(double) == 1).any()):
        raise InputError(f"{where}: no knot may be threefold, and none at the ends double")
    bad = double[u[double] != u[double + 1]]
    if bad.size:
        raise InputError(f"{where}: u differs on the two sides of the double knot sigma[{bad[0]}]")
    if (np.diff(u) < 0.0).any():
        raise InputError(f"{where}: u[{int(np.argmax(np.diff(u) < 0.0)) + 1}] is less than the one before")
