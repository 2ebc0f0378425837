"""Tracking loops: codes, signals, correlators, discriminators, loop filters, and what aiding is worth to them.

Conventions of this room, besides those of the package:

- All spectral densities are one-sided unless a name says otherwise; ``cn0`` is C/N0, as q [Hz] or in dBHz.
- The signal ratio of an integration over T is ``a = 2 q T``. Correlators are scaled so that a perfectly matched one has
  the mean a and each of its quadratures the variance a.
- A discriminator sees offsets: what is received minus the replica (measured minus predicted, as an innovation), in
  chips of delay, radians of phase, rad/s of angular frequency. Errors of a loop are replica minus truth.
- ``Z = I + j Q = a rho exp(j offset)``: Q grows with the phase offset. The thesis on the code and phase loops (Surikov
  2012), whose equations are cited by their numbers, has Q with the other sign and so writes its discriminator -I Q.
- The early replica comes before the prompt one, the late replica after it; a signal later than the replica makes late
  larger, and delay discriminators are late minus early. The thesis has the names the other way round and writes E - L.
- Carrier phase advances with a positive Doppler; delay grows with distance, so that their rates have opposite signs.
"""
