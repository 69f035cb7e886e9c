# The heavy top by the classical Runge-Kutta method, about its fixed point, in quaternions; h and the last time are in BEGIN.
# y = (q0..q3, Omega): q' = q * (0, Omega) / 2, J Omega' = J Omega x Omega + m g l (e_3 x R^T e_Z), about O
function rates(y, d) {
    d[0] = -(y[1]*y[4] + y[2]*y[5] + y[3]*y[6]) / 2
    d[1] = (y[0]*y[4] + y[2]*y[6] - y[3]*y[5]) / 2
    d[2] = (y[0]*y[5] + y[3]*y[4] - y[1]*y[6]) / 2
    d[3] = (y[0]*y[6] + y[1]*y[5] - y[2]*y[4]) / 2
    k1 = 2 * (y[1]*y[3] - y[0]*y[2]); k2 = 2 * (y[2]*y[3] + y[0]*y[1])  # R^T e_Z
    d[4] = ((It - Ia) * y[5]*y[6] + m*g*l*k2) / It
    d[5] = ((Ia - It) * y[6]*y[4] - m*g*l*k1) / It
    d[6] = 0
}
function row(t) {
    x = 2*l*(y[1]*y[3] + y[0]*y[2]); Y = 2*l*(y[2]*y[3] - y[0]*y[1]); z = l*(1 - 2*(y[1]*y[1] + y[2]*y[2]))
    printf "%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g\n", t, x, Y, z, y[0], y[1], y[2], y[3], y[4], y[5], y[6]
}
BEGIN {
    m = 5; g = 9.81; l = 0.1; It = 0.1; Ia = 0.01; h = 0.001; pi = atan2(0, -1)
    y[0] = cos(pi/18); y[1] = sin(pi/18); y[2] = y[3] = y[4] = y[5] = 0; y[6] = 50  # 20 deg about X, spin
    print "t,x,y,z,q0,q1,q2,q3,wx,wy,wz"
    row(0)
    for (n = 1; n <= 1000; n++) {
        rates(y, a); for (i = 0; i < 7; i++) s[i] = y[i] + h/2*a[i]
        rates(s, b); for (i = 0; i < 7; i++) s[i] = y[i] + h/2*b[i]
        rates(s, c); for (i = 0; i < 7; i++) s[i] = y[i] + h*c[i]
        rates(s, d); for (i = 0; i < 7; i++) y[i] += h/6*(a[i] + 2*b[i] + 2*c[i] + d[i])
        row(n*h)
    }
}
