/*
 * volcomp_bridge: LinuxCNC's end of the link to volcompd (docs/protocol.md, version 1).
 *
 * A userspace HAL component. Once per servo cycle it takes the newest record that `sampler` has written (one coherent
 * picture of the cycle), sends it as a Position and turns the Correction that comes back into pins. It serves both
 * wirings: `count-*` for LinuxCNC's external offsets, `corr-*` for a correction added behind the motion controller.
 *
 * Assumptions: axes in the order of the joints, linear, in mm (both are checked against the INI file's words on the
 * command line), little-endian computer, one daemon, on this computer. What is sampled is fixed: for n
 * axes n nominal positions, n actual, n applied offsets, n requested offsets (float), n latched counts (s32), enabled,
 * homed, limited, e-stop released (bit), velocity along the path in mm/s (float).
 *
 * The offset is never stepped, whatever the daemon says or does not say: section 7 of docs/protocol.md.
 */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <rtapi.h>
#include <hal.h>

enum { AXES_MAX = 3, PEERS = 8, FRAME_MAX = 512, SAMPLER_KEY = 0x48534130 };
enum { DAEMON_HELLO = 1, CONTROL_HELLO, ERROR, CLOSE, POSITION = 0x10, CORRECTION, HEARTBEAT, TOOL };
enum { E_VERSION = 1, E_BAD_FRAME, E_WRONG_MACHINE, E_UNEXPECTED = 6, E_BUSY };
enum { ACTIVE = 3, FADING_TO_STATIC = 7 }; /* states of a daemon that compensates */
enum { HOMED = 1, ENABLED = 2, ESTOP = 4, MOVING = 8, LIMITED = 16, RAMPING = 32 };

#define PRIORITY 45              /* SCHED_FIFO: below the servo thread, above volcompd, whose answers it waits for */
#define MS 1000000ll
#define HELLO_NS (1000 * MS)     /* patience with a peer's hello, and with its end of stream */
#define SILENCE_NS (1000 * MS)   /* a daemon silent for longer is dead */
#define HEARTBEAT_NS (100 * MS)  /* own silence after which a life sign is sent */
#define MM_PER_COUNT 1e-6        /* eoffset-scale of the HAL file */
#define FOREIGN_MM 1e-5          /* an offset that differs by more from what was asked for was changed by another */
#define READS 16                 /* most reads of one peer before the next look at HAL */

typedef struct { char magic[4]; uint8_t version, type; uint16_t length; } header_t;
typedef struct {
    header_t header; uint8_t version_min, version_max, reserved[6]; char machine[32], software[32]; uint32_t crc;
} daemon_hello_t;
typedef struct {
    header_t header; uint8_t chosen_version, axis_count, reserved[6]; uint64_t cycle_ns;
    char machine[32], software[32]; uint8_t axes[8][2]; uint32_t crc, padding;
} control_hello_t;
typedef struct { header_t header; uint8_t code, reserved[7]; char detail[32]; uint32_t crc, padding; } report_t;
typedef struct { header_t header; uint8_t reason, reserved[3]; uint32_t crc; } close_t;
typedef struct {
    header_t header; uint32_t sequence; uint16_t state; uint8_t reserved[2]; int64_t control_ns;
    double feed_mm_per_min, commanded[8], actual[8], applied[8]; uint32_t crc, padding;
} position_t;
typedef struct {
    header_t header; uint32_t sequence; uint8_t state, limited, reserved[2]; double offset[8]; uint32_t crc, padding;
} correction_t;
typedef struct { header_t header; uint32_t count, reserved; int64_t time_ns; uint32_t crc, padding; } heartbeat_t;
_Static_assert(offsetof(daemon_hello_t, crc) == 80 && offsetof(control_hello_t, crc) == 104, "layout of the hellos");
_Static_assert(offsetof(report_t, crc) == 48 && offsetof(close_t, crc) == 12, "layout of the reports");
_Static_assert(offsetof(position_t, crc) == 224 && offsetof(correction_t, crc) == 80, "layout of a cycle's frames");
_Static_assert(offsetof(heartbeat_t, crc) == 24, "layout of the life sign");

/* A frame that has come, whatever it is. */
typedef union {
    header_t header;
    daemon_hello_t hello;
    correction_t correction;
    heartbeat_t beat;
    close_t bye;
    report_t report;
    uint8_t bytes[FRAME_MAX];
} frame_t;

/* What one servo cycle looked like. */
typedef struct {
    uint32_t sequence;
    double nominal[AXES_MAX], actual[AXES_MAX], applied[AXES_MAX], request[AXES_MAX];
    int32_t counts[AXES_MAX];
    bool enabled, homed, limited, estop, moving;
    double velocity_mm_per_s;
} record_t;

typedef struct {
    hal_s32_t *count[AXES_MAX];   /* out: for axis.L.eoffset-counts */
    hal_float_t *corr[AXES_MAX];  /* out: the same offset in mm, for an adder behind the motion controller */
    hal_bit_t *enable;            /* out: for axis.L.eoffset-enable */
    hal_bit_t *alive;             /* out: changes with every cycle, for a watchdog */
    hal_bit_t *connected, *limited, *ramping_out;
    hal_float_t *compensated;     /* out: share of the cycles of the last second that were compensated, % */
    hal_u32_t *state, *cycles, *coalesced, *rejected, *left_out;
    hal_float_t limit_mm, rate_mm_per_s, ramp_mm_per_s, hold_s; /* parameters */
} pins_t;

typedef enum { FREE, GREETING, RUNNING, LEAVING } place_t;
typedef struct {
    int fd;
    place_t place;
    int64_t since_ns, heard_ns, sent_ns;
    uint8_t in[2 * FRAME_MAX], out[FRAME_MAX];
    size_t in_size, out_from, out_size;
} peer_t;

typedef enum { FOLLOWING, KEPT, RAMPING_OUT } stage_t;

static struct {
    const char *name, *machine, *axes;
    long port, sampler;
    int axis_count;
    bool counts; /* wiring A: the correction goes out as counts, and LinuxCNC says which it has seen */
    int64_t cycle_ns;
} config = { .name = "volcomp", .machine = "linuxcnc", .axes = "XYZ", .port = 7878, .cycle_ns = 1000000 };

static struct {
    stage_t mode;
    double value[AXES_MAX], target[AXES_MAX]; /* mm */
    int64_t missing, budget;                  /* cycles without a good correction; cycles not yet moved for */
    uint32_t answered, immovable;             /* sequence numbers */
    bool any_answered, known, movable, limited;
    bool unaware;                             /* no answer yet to a cycle in which it could move again */
    bool written;                             /* counts were written since it is known */
} offset;

static pins_t *pins;
static peer_t peers[PEERS];
static record_t record;
static bool have_record;
static uint32_t heartbeats;
static volatile sig_atomic_t stopping;

static int64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000ll + t.tv_nsec;
}

/* A line for whoever reads; none where nobody has room for it, for the cycle does not wait. */
static void say(const char *what, const char *detail) {
    struct pollfd reader = { .fd = STDERR_FILENO, .events = POLLOUT };
    if (poll(&reader, 1, 0) != 1 || (reader.revents & POLLOUT) == 0) return;
    fprintf(stderr, "%s: %s%s%s\n", config.name, what, *detail ? ": " : "", detail);
}

/* --- frames ------------------------------------------------------------------------------------------------------ */

static uint32_t crc32c(const void *data, size_t n) {
    static uint32_t table[256];
    const uint8_t *p = data;
    uint32_t c = 0xffffffffu;
    if (table[1] == 0)
        for (uint32_t i = 0; i < 256; i++) {
            uint32_t v = i;
            for (int k = 0; k < 8; k++) v = (v >> 1) ^ (v & 1 ? 0x82f63b78u : 0);
            table[i] = v;
        }
    while (n--) c = (c >> 8) ^ table[(c ^ *p++) & 0xff];
    return ~c;
}

/* Bytes of a known type; 0 where the type is not known. */
static uint16_t length_of(uint8_t type) {
    switch (type) {
    case DAEMON_HELLO: return 84;
    case CONTROL_HELLO: return 108;
    case ERROR: return 52;
    case CLOSE: return 16;
    case POSITION: return 228;
    case CORRECTION: return 84;
    case HEARTBEAT: return 28;
    case TOOL: return 44;
    default: return 0;
    }
}

/* The eight bytes of a header: 0 where they are right, else the error code. */
static int judge_header(const header_t *h, bool agreed) {
    bool eternal = h->type >= DAEMON_HELLO && h->type <= CLOSE;
    if (memcmp(h->magic, "VCMP", 4) != 0) return E_BAD_FRAME;
    if (eternal ? h->version != 0 : h->type < 0x80 ? h->version != 1 : h->version > (agreed ? 1 : 0)) return E_VERSION;
    if (h->type < 0x80 && length_of(h->type) == 0) return E_BAD_FRAME;
    if (h->type < 0x80 ? h->length != length_of(h->type) : h->length < 12 || h->length > FRAME_MAX) return E_BAD_FRAME;
    return 0;
}

/* Text into a field that need not end in a zero byte. */
static void put_text(char field[32], const char *text) {
    size_t n = strlen(text);
    memset(field, 0, 32);
    memcpy(field, text, n < 32 ? n : 32);
}

static bool all_zero(const void *bytes, size_t n) {
    const uint8_t *p = bytes;
    while (n > 0 && p[n - 1] == 0) n--;
    return n == 0;
}

/* --- peers ------------------------------------------------------------------------------------------------------- */

static void drop(peer_t *peer) {
    close(peer->fd);
    if (peer->place == RUNNING) say("daemon gone", "");
    *peer = (peer_t){ .fd = -1, .place = FREE };
}

/* Writes what is left of a frame; false where the connection is over. */
static bool flush_out(peer_t *peer) {
    while (peer->out_from < peer->out_size) {
        ssize_t n = send(peer->fd, peer->out + peer->out_from, peer->out_size - peer->out_from, MSG_NOSIGNAL);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0 && errno == EAGAIN) return true;
        if (n <= 0) return false;
        peer->out_from += (size_t)n;
    }
    peer->out_from = peer->out_size = 0;
    return true;
}

/* Sends a frame with one write, or leaves it out as a whole where there is no room. */
static bool post(peer_t *peer, void *frame, uint8_t type) {
    uint16_t length = length_of(type);
    header_t h = { { 'V', 'C', 'M', 'P' }, type <= CLOSE ? 0 : 1, type, length };
    memcpy(frame, &h, sizeof h);
    uint32_t crc = crc32c(frame, length - 4u);
    memcpy((char *)frame + length - 4, &crc, 4);
    if (!flush_out(peer)) return false;
    if (peer->out_size > 0) {
        (*pins->left_out)++;
        return true;
    }
    memcpy(peer->out, frame, length);
    peer->out_size = length;
    if (!flush_out(peer)) return false;
    if (peer->out_size > 0 && peer->out_from == 0) {
        peer->out_size = 0;
        (*pins->left_out)++;
        return true;
    }
    peer->sent_ns = now_ns();
    return true;
}

/* The last frame is out: no more is sent, the rest is read until the end of the stream. */
static void leave(peer_t *peer) {
    shutdown(peer->fd, SHUT_WR);
    peer->place = LEAVING;
    peer->since_ns = now_ns();
    peer->in_size = 0;
}

static void refuse(peer_t *peer, uint8_t code, const char *detail) {
    report_t error;
    memset(&error, 0, sizeof error);
    error.code = code;
    put_text(error.detail, detail);
    say("peer refused", detail);
    if (post(peer, &error, ERROR)) leave(peer);
    else drop(peer);
}

static peer_t *running(void) {
    for (int k = 0; k < PEERS; k++)
        if (peers[k].place == RUNNING) return &peers[k];
    return NULL;
}

static void greet(peer_t *peer, const daemon_hello_t *hello) {
    control_hello_t answer;
    char detail[33] = "";
    memset(&answer, 0, sizeof answer);
    put_text(answer.machine, config.machine);
    put_text(answer.software, "volcomp_bridge 1 (LinuxCNC)");
    if (!all_zero(hello->reserved, sizeof hello->reserved) || hello->version_min < 1 ||
        hello->version_max < hello->version_min) {
        refuse(peer, E_BAD_FRAME, "hello");
    } else if (hello->version_min > 1) {
        refuse(peer, E_VERSION, "this control speaks 1");
    } else if (memcmp(hello->machine, answer.machine, sizeof answer.machine) != 0) {
        snprintf(detail, sizeof detail, "this is %.24s", config.machine);
        refuse(peer, E_WRONG_MACHINE, detail);
    } else if (running() != NULL) {
        refuse(peer, E_BUSY, "another daemon is connected");
    } else {
        answer.chosen_version = 1;
        answer.axis_count = (uint8_t)config.axis_count;
        answer.cycle_ns = (uint64_t)config.cycle_ns;
        for (int k = 0; k < config.axis_count; k++) {
            answer.axes[k][0] = (uint8_t)config.axes[k];
            answer.axes[k][1] = 1;
        }
        peer->place = RUNNING;
        offset.any_answered = false;
        say("daemon connected", "");
        if (!post(peer, &answer, CONTROL_HELLO)) drop(peer);
    }
}

/* --- the offset: section 7 of docs/protocol.md --------------------------------------------------------------------- */

/* What anybody may set: what is no positive number counts as the default, what is too large as the most. */
static const struct { double usual, most; } limit_mm = { 1.0, 10.0 }, rate_mm_per_s = { 1.0, 5.0 },
                                            ramp_mm_per_s = { 0.1, 5.0 }, hold_s = { 0.1, 10.0 };
#define SANE(parameter) \
    (isfinite(pins->parameter) && pins->parameter > 0.0 ? fmin(pins->parameter, parameter.most) : parameter.usual)

static int64_t hold_cycles(void) {
    double cycles = SANE(hold_s) * 1e9 / (double)config.cycle_ns;
    return cycles < 1.0 ? 1 : (int64_t)llround(cycles);
}

/* Puts the offset on the pins. */
static void show_offset(void) {
    bool zero = true;
    for (int k = 0; k < config.axis_count; k++) {
        zero &= offset.value[k] == 0.0;
        *pins->corr[k] = offset.value[k];
    }
    *pins->enable = true;
    *pins->limited = offset.limited || record.limited;
    *pins->ramping_out = offset.mode == RAMPING_OUT && !zero;
}

/* Moves the offset towards its target for the cycles that have passed. */
static void move_offset(void) {
    double seconds = (double)offset.budget * (double)config.cycle_ns * 1e-9;
    double rate = offset.mode == RAMPING_OUT ? SANE(ramp_mm_per_s) : SANE(rate_mm_per_s), size = SANE(limit_mm);
    offset.budget = 0;
    offset.limited = false;
    for (int k = 0; k < config.axis_count && offset.movable; k++) {
        double wanted = offset.mode == RAMPING_OUT ? 0.0 : offset.target[k];
        double goal = fmin(fmax(wanted, -size), size), step = rate * seconds;
        offset.value[k] += fmin(fmax(goal - offset.value[k], -step), step);
        offset.limited |= offset.mode == FOLLOWING && offset.value[k] != wanted;
        /* LinuxCNC takes counts as increments, and only while it can move: what it has made of them so far is the base */
        *pins->count[k] = (int32_t)(uint32_t)llround((double)record.counts[k] - record.request[k] / MM_PER_COUNT +
                                                     offset.value[k] / MM_PER_COUNT);
        offset.written = true;
    }
    show_offset();
}

/* What LinuxCNC holds and has been asked for is not what this offset has come to: it was changed by another. */
static bool is_foreign(void) {
    bool foreign = false;
    for (int k = 0; k < config.axis_count && config.counts && offset.written; k++) {
        int32_t on_the_way = (int32_t)((uint32_t)*pins->count[k] - (uint32_t)record.counts[k]);
        foreign |= fabs(record.request[k] + on_the_way * MM_PER_COUNT - offset.value[k]) > FOREIGN_MM;
    }
    return foreign;
}

/* A new servo cycle, `passed` after the one before. */
static void begin_cycle(int64_t passed) {
    bool readable = true;
    for (int k = 0; k < config.axis_count; k++) readable &= isfinite(record.request[k]);
    bool movable = readable && record.enabled && record.homed && !record.estop;
    /* the first cycle in which it can move again is one in which it could not: only there LinuxCNC has made what it held
       part of the position; a stop and a start that went by unseen show in what it holds */
    bool goes_on = offset.known && offset.movable && movable && !is_foreign();
    if (goes_on && offset.budget > 0) move_offset(); /* no correction came for the cycle before */
    offset.missing += passed;
    offset.budget = passed < 10 ? passed : 10; /* a long stall is not caught up with in one step */
    offset.movable = movable;
    if (offset.mode == FOLLOWING && offset.missing > hold_cycles()) offset.mode = RAMPING_OUT;
    if (goes_on || !readable) return;
    /* what LinuxCNC holds counts, and the way starts from there */
    for (int k = 0; k < config.axis_count; k++) offset.value[k] = offset.target[k] = record.request[k];
    offset.immovable = record.sequence;
    offset.unaware = offset.known = true;
    offset.limited = offset.written = false;
    show_offset();
}

static void take_correction(const correction_t *c) {
    int32_t age = (int32_t)(record.sequence - c->sequence);
    bool good = have_record && age >= 0 && age <= hold_cycles();
    for (int k = 0; k < config.axis_count; k++) good &= isfinite(c->offset[k]);
    if (offset.any_answered) good &= (int32_t)(c->sequence - offset.answered) >= 0;
    *pins->state = c->state;
    if (!good) {
        (*pins->rejected)++;
        return;
    }
    offset.answered = c->sequence;
    offset.any_answered = true;
    offset.missing = 0;
    offset.mode = FOLLOWING;
    /* an answer to a cycle in which nothing could move knows nothing of what LinuxCNC has made of the offset since */
    if (offset.unaware && (int32_t)(c->sequence - offset.immovable) > 0) offset.unaware = false;
    if (!offset.unaware) memcpy(offset.target, c->offset, sizeof offset.target);
    if (offset.budget > 0) move_offset();
}

/* --- what a peer says ---------------------------------------------------------------------------------------------- */

static void take_frame(peer_t *peer, const frame_t *frame) {
    const header_t *h = &frame->header;
    bool is_running = peer->place == RUNNING;
    if (h->type == DAEMON_HELLO && !is_running) {
        greet(peer, &frame->hello);
    } else if (h->type == CORRECTION && is_running) {
        const correction_t *c = &frame->correction;
        if (c->state > 7 || !all_zero(c->reserved, sizeof c->reserved)) refuse(peer, E_BAD_FRAME, "correction");
        else take_correction(c);
    } else if (h->type == HEARTBEAT && is_running) {
        const heartbeat_t *beat = &frame->beat;
        if (beat->reserved != 0) refuse(peer, E_BAD_FRAME, "heartbeat");
    } else if (h->type == CLOSE) {
        const close_t *bye = &frame->bye;
        /* in order: the offset stays where the daemon has brought it */
        if (is_running && bye->reason <= 1 && offset.mode == FOLLOWING) offset.mode = KEPT;
        say(bye->reason <= 1 ? "daemon has left in order" : "daemon has left with an error", "");
        leave(peer);
    } else if (h->type == ERROR) {
        const report_t *error = &frame->report;
        char detail[33] = "";
        for (int k = 0; k < 32 && error->detail[k] != 0; k++)
            detail[k] = error->detail[k] >= ' ' && error->detail[k] < 127 ? error->detail[k] : '?';
        say("error told by the daemon", detail);
        leave(peer);
    } else if (h->type < 0x80) {
        refuse(peer, E_UNEXPECTED, "not now");
    }
}

static void take_frames(peer_t *peer) {
    size_t at = 0;
    while ((peer->place == GREETING || peer->place == RUNNING) && peer->in_size - at >= sizeof(header_t)) {
        frame_t frame;
        header_t h;
        uint32_t crc;
        memcpy(&h, peer->in + at, sizeof h);
        int code = judge_header(&h, peer->place == RUNNING);
        if (code != 0) {
            refuse(peer, (uint8_t)code, "header");
            return;
        }
        if (peer->in_size - at < h.length) break;
        memcpy(frame.bytes, peer->in + at, h.length);
        memcpy(&crc, frame.bytes + h.length - 4, 4);
        if (crc32c(frame.bytes, h.length - 4u) != crc) {
            refuse(peer, E_BAD_FRAME, "check sum");
            return;
        }
        at += h.length;
        take_frame(peer, &frame);
    }
    if (peer->place == GREETING || peer->place == RUNNING) {
        peer->in_size -= at;
        memmove(peer->in, peer->in + at, peer->in_size);
    }
}

static void read_peer(peer_t *peer) {
    for (int reads = 0; peer->place != FREE && reads < READS; reads++) {
        if (peer->place == LEAVING) peer->in_size = 0;
        ssize_t n = recv(peer->fd, peer->in + peer->in_size, sizeof peer->in - peer->in_size, 0);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0 && errno == EAGAIN) return;
        if (n <= 0) {
            drop(peer);
            return;
        }
        peer->heard_ns = now_ns();
        peer->in_size += (size_t)n;
        take_frames(peer);
    }
}

static void tend_peer(peer_t *peer, int64_t now) {
    heartbeat_t beat;
    if (peer->place == LEAVING && now - peer->since_ns > HELLO_NS) drop(peer);
    if (peer->place == GREETING && now - peer->since_ns > HELLO_NS) refuse(peer, E_UNEXPECTED, "no DaemonHello in time");
    if (peer->place == RUNNING && now - peer->heard_ns > SILENCE_NS) drop(peer);
    if (peer->place == RUNNING && now - peer->sent_ns > HEARTBEAT_NS) {
        memset(&beat, 0, sizeof beat);
        beat.count = ++heartbeats;
        beat.time_ns = now;
        if (!post(peer, &beat, HEARTBEAT)) drop(peer);
    }
}

static void set_option(int fd, int level, int option, int value) {
    if (setsockopt(fd, level, option, &value, sizeof value) != 0) say("socket option refused", strerror(errno));
}

static void accept_peer(int listener) {
    int fd = accept4(listener, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (fd < 0) return;
    peer_t *peer = NULL;
    for (int k = 0; k < PEERS && peer == NULL; k++)
        if (peers[k].place == FREE) peer = &peers[k];
    if (peer == NULL) {
        close(fd);
        return;
    }
    set_option(fd, IPPROTO_TCP, TCP_NODELAY, 1);
    set_option(fd, SOL_SOCKET, SO_KEEPALIVE, 1);
    set_option(fd, IPPROTO_TCP, TCP_KEEPIDLE, 1);
    set_option(fd, IPPROTO_TCP, TCP_KEEPINTVL, 1);
    set_option(fd, IPPROTO_TCP, TCP_KEEPCNT, 3);
    set_option(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, 1000);
    int64_t now = now_ns();
    *peer = (peer_t){ .fd = fd, .place = GREETING, .since_ns = now, .heard_ns = now, .sent_ns = now };
    if (running() != NULL) refuse(peer, E_BUSY, "another daemon is connected");
}

static int listen_on_loopback(long port) {
    struct sockaddr_in address = { .sin_family = AF_INET, .sin_port = htons((uint16_t)port) };
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (fd < 0) return -1;
    set_option(fd, SOL_SOCKET, SO_REUSEADDR, 1);
    if (bind(fd, (struct sockaddr *)&address, sizeof address) != 0 || listen(fd, PEERS) != 0) {
        close(fd);
        return -1;
    }
    return fd;
}

/* --- HAL ----------------------------------------------------------------------------------------------------------- */

static int export_pins(int comp) {
    const char *n = config.name;
    int bad = 0;
    pins = hal_malloc(sizeof *pins);
    if (pins == NULL) return -1;
    memset(pins, 0, sizeof *pins);
    for (int k = 0; k < config.axis_count; k++) {
        char letter = (char)(config.axes[k] | 0x20);
        bad |= hal_pin_s32_newf(HAL_OUT, &pins->count[k], comp, "%s.count-%c", n, letter);
        bad |= hal_pin_float_newf(HAL_OUT, &pins->corr[k], comp, "%s.corr-%c", n, letter);
    }
    bad |= hal_pin_bit_newf(HAL_OUT, &pins->enable, comp, "%s.enable", n);
    bad |= hal_pin_bit_newf(HAL_OUT, &pins->alive, comp, "%s.alive", n);
    bad |= hal_pin_bit_newf(HAL_OUT, &pins->connected, comp, "%s.connected", n);
    bad |= hal_pin_bit_newf(HAL_OUT, &pins->limited, comp, "%s.limited", n);
    bad |= hal_pin_bit_newf(HAL_OUT, &pins->ramping_out, comp, "%s.ramping-out", n);
    bad |= hal_pin_float_newf(HAL_OUT, &pins->compensated, comp, "%s.compensated", n);
    bad |= hal_pin_u32_newf(HAL_OUT, &pins->state, comp, "%s.state", n);
    bad |= hal_pin_u32_newf(HAL_OUT, &pins->cycles, comp, "%s.cycles", n);
    bad |= hal_pin_u32_newf(HAL_OUT, &pins->coalesced, comp, "%s.coalesced", n);
    bad |= hal_pin_u32_newf(HAL_OUT, &pins->rejected, comp, "%s.rejected", n);
    bad |= hal_pin_u32_newf(HAL_OUT, &pins->left_out, comp, "%s.left-out", n);
    bad |= hal_param_float_newf(HAL_RW, &pins->limit_mm, comp, "%s.limit", n);
    bad |= hal_param_float_newf(HAL_RW, &pins->rate_mm_per_s, comp, "%s.rate", n);
    bad |= hal_param_float_newf(HAL_RW, &pins->ramp_mm_per_s, comp, "%s.ramp-rate", n);
    bad |= hal_param_float_newf(HAL_RW, &pins->hold_s, comp, "%s.hold-time", n);
    pins->limit_mm = limit_mm.usual;
    pins->rate_mm_per_s = rate_mm_per_s.usual;
    pins->ramp_mm_per_s = ramp_mm_per_s.usual;
    pins->hold_s = hold_s.usual;
    return bad;
}

/* Share of the cycles of the last second that a compensating daemon has answered, in time for the next one. */
static void count_compensated(int64_t passed, bool answered) {
    static int64_t cycles, good;
    cycles += passed;
    good += answered && *pins->connected && (*pins->state == ACTIVE || *pins->state == FADING_TO_STATIC);
    if (cycles * config.cycle_ns < 1000 * MS) return;
    *pins->compensated = 100.0 * (double)good / (double)cycles;
    cycles = good = 0;
}

/* Reads the newest record of those waiting; gives how many there were. A full queue holds old news: it is emptied. */
static int read_newest(hal_stream_t *stream) {
    union hal_stream_data d[6 * AXES_MAX + 5];
    unsigned sample = 0;
    int n = config.axis_count, count = 0;
    bool stale = hal_stream_depth(stream) >= hal_stream_maxdepth(stream) - 1;
    while (hal_stream_readable(stream) && hal_stream_read(stream, d, &sample) == 0) count++;
    if (count == 0 || stale) return 0;
    record_t r = { .sequence = sample };
    for (int k = 0; k < n; k++) {
        r.nominal[k] = d[k].f;
        r.actual[k] = d[n + k].f;
        r.applied[k] = d[2 * n + k].f;
        r.request[k] = d[3 * n + k].f;
        r.counts[k] = d[4 * n + k].s;
    }
    r.enabled = d[5 * n].b;
    r.homed = d[5 * n + 1].b;
    r.limited = d[5 * n + 2].b;
    r.estop = !d[5 * n + 3].b;
    r.velocity_mm_per_s = d[5 * n + 4].f;
    int64_t passed = have_record ? (int32_t)(r.sequence - record.sequence) : 1;
    if (passed < 1) passed = 1; /* the sampler was loaded anew */
    /* the velocity is that of all axes; where only others go, these stand still */
    for (int k = 0; k < n; k++) r.moving |= r.nominal[k] != record.nominal[k];
    record = r;
    bool answered = have_record && offset.missing == 0;
    have_record = true;
    begin_cycle(passed);
    count_compensated(passed, answered);
    *pins->coalesced += (hal_u32_t)(count - 1);
    (*pins->cycles)++;
    *pins->alive = !*pins->alive;
    return count;
}

static void send_position(peer_t *peer) {
    static int64_t wraps;
    static uint32_t last;
    position_t p;
    memset(&p, 0, sizeof p);
    if (record.sequence < last) wraps++;
    last = record.sequence;
    p.sequence = record.sequence;
    p.control_ns = ((wraps << 32) + record.sequence) * config.cycle_ns;
    p.state = (uint16_t)((record.homed ? HOMED : 0) | (record.enabled ? ENABLED : 0) | (record.estop ? ESTOP : 0) |
                         (record.moving ? MOVING : 0) | (*pins->limited ? LIMITED : 0) | (*pins->ramping_out ? RAMPING : 0));
    p.feed_mm_per_min = record.moving ? fmax(record.velocity_mm_per_s, 0.0) * 60.0 : 0.0;
    memcpy(p.commanded, record.nominal, sizeof record.nominal);
    memcpy(p.actual, record.actual, sizeof record.actual);
    memcpy(p.applied, record.applied, sizeof record.applied);
    if (!post(peer, &p, POSITION)) drop(peer);
}

/* Real-time scheduling where the system permits it (rtprio in limits.conf); without it a busy computer costs cycles. */
static void be_punctual(void) {
    struct sched_param parameter = { .sched_priority = PRIORITY };
    if (sched_setscheduler(0, SCHED_FIFO, &parameter) != 0) say("no real-time priority", strerror(errno));
    if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) say("memory is not locked", strerror(errno));
}

static void on_signal(int number) {
    (void)number;
    stopping = 1;
}

static void run(hal_stream_t *stream, int listener) {
    int64_t arrived = now_ns();
    while (!stopping) {
        struct pollfd fds[PEERS + 1] = { { .fd = listener, .events = POLLIN } };
        for (int k = 0; k < PEERS; k++) fds[k + 1] = (struct pollfd){ .fd = peers[k].fd, .events = POLLIN };
        /* asleep until shortly before the next cycle, then looking often: HAL has nothing to wait for */
        int64_t left = arrived + config.cycle_ns * 9 / 10 - now_ns();
        struct timespec pause = { 0, (long)(left > 50000 ? left : 50000) };
        if (ppoll(fds, PEERS + 1, &pause, NULL) > 0) {
            for (int k = 0; k < PEERS; k++)
                if (fds[k + 1].revents != 0 && peers[k].place != FREE) read_peer(&peers[k]);
            if (fds[0].revents != 0) accept_peer(listener);
        }
        int64_t now = now_ns();
        if (read_newest(stream) > 0) {
            arrived = now;
            peer_t *peer = running();
            if (peer != NULL) send_position(peer);
        }
        for (int k = 0; k < PEERS; k++) tend_peer(&peers[k], now);
        *pins->connected = running() != NULL;
    }
}

static void farewell(void) {
    close_t bye;
    memset(&bye, 0, sizeof bye);
    peer_t *peer = running();
    if (peer == NULL || !post(peer, &bye, CLOSE)) return;
    shutdown(peer->fd, SHUT_WR);
    for (int64_t end = now_ns() + HELLO_NS; now_ns() < end;) {
        struct pollfd fd = { .fd = peer->fd, .events = POLLIN };
        if (poll(&fd, 1, 50) > 0 && recv(peer->fd, peer->in, sizeof peer->in, 0) <= 0) return;
    }
}

/* A number and nothing else; -1 where it is none. */
static long number(const char *text) {
    char *end;
    errno = 0;
    long value = strtol(text, &end, 10);
    return errno != 0 || end == text || *end != 0 ? -1 : value;
}

/* What is wrong with the INI file's own words about the machine: its units, and its coordinates in the order of the joints. */
static const char *unfit(const char *units, char **words, int count) {
    char joints[16] = "";
    if (strcmp(units, "mm") != 0 && strcmp(units, "metric") != 0)
        return "only machines in millimetres: --units is [TRAJ]LINEAR_UNITS";
    for (int k = 0; k < count; k++) {
        if (strlen(joints) + strlen(words[k]) >= sizeof joints) return "too many coordinates";
        strcat(joints, words[k]);
    }
    size_t axes = strlen(config.axes);
    if (strncasecmp(joints, config.axes, axes) != 0 || strpbrk(joints + axes, config.axes) != NULL)
        return "the machine's coordinates ([TRAJ]COORDINATES, one letter a joint) do not begin with --axes, or have a joint"
               " twice";
    return NULL;
}

/* What is wrong with the arguments, or nothing. */
static const char *read_arguments(int count, char **arguments) {
    static const struct option known[] = {
        { "name", required_argument, NULL, 'n' },     { "machine", required_argument, NULL, 'm' },
        { "axes", required_argument, NULL, 'a' },     { "port", required_argument, NULL, 'p' },
        { "cycle-ns", required_argument, NULL, 'c' }, { "sampler", required_argument, NULL, 's' },
        { "units", required_argument, NULL, 'u' },    { "wiring", required_argument, NULL, 'w' },
        { NULL, 0, NULL, 0 },
    };
    const char *units = "", *wiring = "";
    for (int o; (o = getopt_long(count, arguments, "", known, NULL)) != -1;) {
        switch (o) {
        case 'n': config.name = optarg; break;
        case 'm': config.machine = optarg; break;
        case 'a': config.axes = optarg; break;
        case 'p': config.port = number(optarg); break;
        case 'c': config.cycle_ns = number(optarg); break;
        case 's': config.sampler = number(optarg); break;
        case 'u': units = optarg; break;
        case 'w': wiring = optarg; break;
        default: return "";
        }
    }
    size_t axes = strlen(config.axes);
    config.axis_count = (int)axes;
    config.counts = strcmp(wiring, "eoffset") == 0;
    if (axes < 1 || axes > AXES_MAX || strspn(config.axes, "XYZUVW") != axes) return "--axes: one to three of XYZUVW";
    if (strlen(config.machine) > 32) return "--machine: at most 32 bytes";
    if (config.port < 1 || config.port > 65535) return "--port: 1 to 65535";
    if (config.cycle_ns < 250000 || config.cycle_ns > 10000000) return "--cycle-ns: 250000 to 10000000";
    if (config.sampler < 0 || config.sampler > 7) return "--sampler: 0 to 7";
    if (!config.counts && strcmp(wiring, "inject") != 0) return "--wiring: eoffset or inject";
    return unfit(units, arguments + optind, count - optind);
}

int main(int count, char **arguments) {
    static const char *const layouts[] = { "", "ffffsbbbbf", "ffffffffssbbbbf", "ffffffffffffsssbbbbf" };
    hal_stream_t stream;
    const char *wrong = read_arguments(count, arguments);
    if (wrong != NULL) {
        fprintf(stderr, "%s%susage: volcomp_bridge --wiring eoffset|inject --units mm [--name volcomp] [--machine ID]"
                        " [--axes XYZ] [--port 7878] [--cycle-ns 1000000] [--sampler 0] X Y Z\n",
                wrong, *wrong ? "\n" : "");
        return 64;
    }
    struct sigaction action = { .sa_handler = on_signal }, ignore = { .sa_handler = SIG_IGN };
    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGHUP, &action, NULL); /* a terminal that closes must not leave the offset behind */
    sigaction(SIGPIPE, &ignore, NULL);
    for (int k = 0; k < PEERS; k++) peers[k].fd = -1;
    int comp = hal_init(config.name);
    if (comp < 0) {
        say("HAL refuses this name", "is there another bridge, or one that was killed? see adapters/linuxcnc/README.md");
        return 1;
    }
    int status = 1, listener = -1;
    if (hal_stream_attach(&stream, comp, SAMPLER_KEY + (int)config.sampler, layouts[config.axis_count]) < 0) {
        say("no sampler channel with the layout", layouts[config.axis_count]);
        hal_exit(comp);
        return 1;
    }
    if (export_pins(comp) != 0) {
        say("pins cannot be exported", "");
    } else if ((listener = listen_on_loopback(config.port)) < 0) {
        say("cannot listen on loopback", strerror(errno));
    } else {
        be_punctual();
        hal_ready(comp);
        run(&stream, listener);
        farewell();
        status = 0;
    }
    hal_stream_detach(&stream);
    hal_exit(comp);
    return status;
}
