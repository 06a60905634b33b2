// Fine grain: woodfit/fine_grain_noise.py in GLSL (ESSL 3.00 and GLSL 3.30 and later). Lengths in px.

uint wp_hash(int i, int j, int k, uint seed) {
    uint bits = (uint(i) * 0x9E3779B1u) ^ (uint(j) * 0x85EBCA77u) ^ (uint(k) * 0xC2B2AE3Du) ^ seed;
    bits = (bits ^ (bits >> 16u)) * 0x85EBCA6Bu;
    bits = (bits ^ (bits >> 13u)) * 0xC2B2AE35u;
    return bits ^ (bits >> 16u);
}

int wp_around(int number, int period) {
    if (period <= 0) return number;
    int rest = number % period;
    return rest < 0 ? rest + period : rest;
}

float wp_impulses(int i, int j, float a, float p, float q, float reach, int period, float density, uint seed) {
    float along = a + float(wp_hash(i, j, 7919, seed) & 0xFFFFFFu) / 16777216.0;
    float low = floor(along);
    float part = along - low;
    float later = part * part * (3.0 - 2.0 * part);
    float total = 0.0;
    for (int end = 0; end < 2; end++) {
        uint bits = wp_hash(i, j, wp_around(int(low) + end, period), seed + 0xC2B2AE3Du);
        float dx = p - float(bits & 0x7FFu) / 2048.0;
        float dy = q - 0.5 - (float((bits >> 11u) & 0x7FFu) / 2048.0 - 0.5) * (2.0 * reach - 1.0);
        float near = reach * reach - dx * dx - dy * dy;
        if (near > 0.0) {
            float chance = float(bits >> 22u) / 1024.0;
            float depth = density > 0.0 ? (chance < density ? -1.0 : 0.0) : 2.0 * chance - 1.0;
            total += (end == 1 ? later : 1.0 - later) * depth * near * near;
        }
    }
    return total;
}

float wp_columns(float p, float q, float a, int period_p, int period_a, uint seed) {
    float total = 0.0;
    int last = int(floor(p + 0.75));
    for (int i = int(floor(p - 0.75)); i <= last; i++) {
        int row = wp_around(i, period_p);
        float place = q + float(wp_hash(row, 104729, 7919, seed) & 0xFFFFFFu) / 16777216.0;
        int above = int(floor(place - 0.5));
        for (int j = above; j < above + 2; j++) {
            total += wp_impulses(row, j, a, p - float(i), place - float(j), 0.75, period_a, 0.0, seed);
        }
    }
    return 10.0 * total;
}

float wp_pores(float p, float q, float a, float density, uint seed) {
    int ip = int(floor(p));
    int iq = int(floor(q));
    float total = 0.0;
    for (int i = ip - 1; i <= ip + 1; i++) {
        for (int j = iq - 1; j <= iq + 1; j++) {
            total += wp_impulses(i, j, a, p - float(i), q - float(j), 1.0, 0, density, seed);
        }
    }
    return total;
}

// One noise: kind 0 fibre, 1 pore, 2 ray, 3 layer. `turn` is the azimuth in turns, 0..1.
float wp_noise(int kind, vec3 cells, float density, uint seed, float radius, float turn, vec2 xy, float height) {
    if (kind == 0) return wp_columns(xy.x / cells.x, xy.y / cells.y, height / cells.z, 0, 0, seed);
    if (kind == 1) return wp_pores(xy.x / cells.x, xy.y / cells.y, height / cells.z, density, seed);
    float arc = kind == 2 ? cells.x : cells.z;
    float level = log2(max(6.283185307179586 * radius / arc / 8.0, 1.0));
    float whole = floor(level);
    float part = level - whole;
    int around = 8 << int(whole);
    float total = 0.0;
    for (int end = 0; end < 2; end++) {
        float fade = end == 1 ? sin(1.5707963267948966 * part) : cos(1.5707963267948966 * part);
        if (fade > 1e-9) {
            float place = turn * float(around);
            uint own = seed + uint(around);
            total += fade * (kind == 2
                ? wp_columns(place, height / cells.y, radius / cells.z, around, 0, own)
                : wp_columns(radius / cells.x, height / cells.y, place, 0, around, own));
        }
        around *= 2;
    }
    return total;
}
