// A woodpipe solid texture in GLSL (ESSL 3.00; GLSL 3.30 and later). docs/solid_texture.md says what it computes.
// Before this file: `precision highp float; precision highp int;`, the #defines of the texture, fine_grain.glsl.
// All tables lie in one texture of floats, WP_ROW to a row, fetched, never filtered.

uniform highp sampler2D wp_tables;

struct WpWood {
    vec3 rgb;          // linear, sRGB primaries
    float age;         // ring age: 0 at the pith, +1 at each ring boundary
    float lateness;    // 0 earlywood to 1 latewood
    float confidence;  // 1 on the photographed faces, falling to 0 away from them
};

float wp_at(int i) {
    return texelFetch(wp_tables, ivec2(i % WP_ROW, i / WP_ROW), 0).r;
}

vec4 wp_at4(int i) {
    return vec4(wp_at(i), wp_at(i + 1), wp_at(i + 2), wp_at(i + 3));
}

vec3 wp_at3(int i) {
    return vec3(wp_at(i), wp_at(i + 1), wp_at(i + 2));
}

// Displacement m at a node column (radius node ir, azimuth node ia), between two heights.
float wp_column(int ir, int ia, int ih, float part) {
    int i = WP_DISPLACEMENT + (ir * WP_AZIMUTHS + ia) * WP_HEIGHTS + ih;
    return mix(wp_at(i), wp_at(i + 1), part);
}

float wp_moved(float r, float azimuth, float height) {
    float pr = clamp((r - WP_RADIUS_FIRST) / WP_RADIUS_STEP, 0.0, float(WP_RADII - 1));
    int ir = min(int(pr), WP_RADII - 2);
    float ph = clamp((height - WP_HEIGHT_FIRST) / WP_HEIGHT_STEP, 0.0, float(WP_HEIGHTS - 1));
    int ih = min(int(ph), WP_HEIGHTS - 2);
    float pa = mod((azimuth - WP_AZIMUTH_FIRST) / WP_AZIMUTH_STEP, WP_AZIMUTH_TURN);
    float last = float(WP_AZIMUTHS - 1);
#if !WP_WRAPS
    // The arc that no face shows is one wide cell.
    if (pa > last) pa = last + (pa - last) / (WP_AZIMUTH_TURN - last);
#endif
    int ia = min(int(pa), WP_AZIMUTHS - 1);
    int ja = ia + 1 == WP_AZIMUTHS ? 0 : ia + 1;
    float fa = pa - float(ia);
    float fh = ph - float(ih);
    float near = mix(wp_column(ir, ia, ih, fh), wp_column(ir, ja, ih, fh), fa);
    float far = mix(wp_column(ir + 1, ia, ih, fh), wp_column(ir + 1, ja, ih, fh), fa);
    return mix(near, far, pr - float(ir));
}

// Ring age counted from WP_FIRST_AGE.
float wp_age(float radius) {
    float beyond = radius - WP_RING_LAST;
    if (beyond >= 0.0) return float(WP_RINGS - 1) + beyond / WP_MEAN_WIDTH;
    if (radius <= WP_RING_FIRST) return WP_FIRST_AGE > 0 ? (radius - WP_RING_FIRST) / WP_FIRST_WIDTH : 0.0;
    int low = 0;
    int high = WP_RINGS - 1;
    for (int step = 0; step < 12; step++) {
        if (high - low <= 1) break;
        int middle = (low + high) / 2;
        if (wp_at(WP_RING_RADIUS + middle) <= radius) low = middle; else high = middle;
    }
    float inner = wp_at(WP_RING_RADIUS + low);
    return float(low) + (radius - inner) / (wp_at(WP_RING_RADIUS + low + 1) - inner);
}

vec4 wp_strip(float age) {
    if (age < 0.0) age = mod(age, WP_STRIP_PERIOD / WP_SAMPLES);
    float place = max(age * WP_SAMPLES - 0.5, 0.0);
    float end = WP_STRIP_SIZE - 0.5;
    if (place >= end) place = end + mod(place - end, WP_STRIP_PERIOD);
    int low = int(place);
    int i = WP_STRIP + 4 * low;
    return mix(wp_at4(i), wp_at4(i + 4), place - float(low));
}

// Logarithm of the fine grain's factor; u is the radius of the fiber through the point.
vec3 wp_grain(float u, float azimuth, float height, float late) {
    float turn = fract(azimuth / 6.283185307179586);
    vec2 xy = u * vec2(cos(azimuth), sin(azimuth));
    vec3 total = vec3(0.0);
    for (int k = 0; k < WP_NOISES; k++) {
        int i = WP_GRAIN + 12 * k;
        vec2 amplitude = vec2(wp_at(i + 5), wp_at(i + 6));
        uint seed = uint(wp_at(i + 10)) | (uint(wp_at(i + 11)) << 16u);
        float value = wp_noise(int(wp_at(i)), wp_at3(i + 1), wp_at(i + 4), seed, u, turn, xy, height);
        total += mix(amplitude.x, amplitude.y, late) * value * wp_at3(i + 7);
    }
    float place = clamp(late, 0.0, 1.0) * 4.0;
    int low = min(int(place), 3);
    int i = WP_LOG_MEAN + 3 * low;
    return total - mix(wp_at3(i), wp_at3(i + 3), place - float(low));
}

// Distance, px, from the nearest photographed rectangle.
float wp_unseen(vec3 p) {
    float least = 1e9;
    for (int f = 0; f < WP_FACES; f++) {
        int i = WP_SEEN + 11 * f;
        vec3 offset = p - wp_at3(i);
        vec3 right = wp_at3(i + 3);
        vec3 down = wp_at3(i + 6);
        float u = clamp(dot(offset, right) / dot(right, right), 0.0, wp_at(i + 9));
        float v = clamp(dot(offset, down) / dot(down, down), 0.0, wp_at(i + 10));
        least = min(least, length(offset - u * right - v * down));
    }
    return least;
}

// Wood at a point of the board frame (x right, y down, z into the wood), in the texture's unit.
WpWood wp_wood(vec3 point, bool detail) {
    vec3 p = point / WP_PIXEL_SIZE;
    vec3 tree = vec3(dot(WP_AXIS_X, p), dot(WP_AXIS_Y, p), dot(WP_AXIS_Z, p)) + WP_ORIGIN;
    float height = tree.z;
    vec2 xy = tree.xy - WP_BEND * height * height;
    float r = length(xy) * max(1.0 + WP_TAPER * height, 0.05);
    float azimuth = r > 0.0 ? atan(xy.y, xy.x) : 0.0;
    float radius = r + wp_moved(r, azimuth, height);
    WpWood wood;
    float age = wp_age(radius);
    vec4 color = wp_strip(age);
    wood.lateness = color.a;
    wood.rgb = color.rgb;
#if WP_NOISES > 0
    if (detail) {
        float u = max(radius - wp_moved(r, azimuth, WP_MIDDLE), 0.0);
        wood.rgb *= exp(wp_grain(u, azimuth, height, color.a));
    }
#endif
    wood.age = age + float(WP_FIRST_AGE);
    float beyond = max(WP_SEEN_FROM - wood.age, 0.0) + max(wood.age - WP_SEEN_TO, 0.0);
    wood.confidence = exp2(-wp_unseen(p) / WP_HALVING - beyond);
    return wood;
}
