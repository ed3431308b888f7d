// Copyright 2026 The rugged_teleop maintainers
// SPDX-License-Identifier: Apache-2.0

/*
 * The devices' side of the wires: a VSC and an ESI drive with two axes on two ptys. It is in C, so that no Python of the
 * instrument counts. All times are nanoseconds of CLOCK_MONOTONIC, which is Python's time.monotonic_ns().
 *
 * usage: rig VSC_LINK DRIVE_LINK, which become links to the ptys. Commands come a line each; answers are lines, too.
 *   stick VALUE          left stick, Y, -1023 to 1023
 *   deadman 0|1          left pad, down
 *   estop 0|1            said by a heartbeat at once, and by every later one; a stopped VSC says neutral sticks
 *   silence 0|1          1: the VSC says nothing
 *   fire estop|deadman|silence   the same, timed from just before the last byte goes out: "t NANOSECONDS" once a disable
 *                        packet is complete. Any other command but the next two ends the timing.
 *   fire stick           the stick let go, timed until a packet has a lesser command than the one before
 *   stat                 "s ENABLE COMMAND COUNT BAD STEP": the newest packet, packets and bad bytes since the start, and
 *                        the largest step of the command since the last stat
 *   packets SINCE        "k TIME ENABLE COMMAND" of each packet kept that came after SINCE, then "end"
 * Environment: STATUS_NS, the period of the drive's status; ENABLE_NS, how long the drive takes to enable.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

enum { JOYSTICK = 0x10, HEARTBEAT = 0x20 };                             /* VSC message types */
enum { PACKET = 10, STATUS = 12, KEPT = 1 << 18 };                      /* bytes, bytes, packets */
static const int64_t JOYSTICK_NS = 20000000, HEARTBEAT_NS = 50000000;

static int vsc, drive;                                                  /* the ptys' masters */
static int stick, deadman, estop, silent;
static int64_t sent_at, fired_at;                                       /* of the VSC's last frame; 0: nothing is timed */
static int enable, command, step;
static int slows;                                                       /* a lesser command is waited for, no disable */
static int64_t asked_at, enable_ns;
static long count, bad;
static struct { int64_t at; int enable, command; } kept[KEPT];

static int64_t now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

static int64_t setting(const char *name, int64_t otherwise)
{
    const char *text = getenv(name);
    return text ? atoll(text) : otherwise;
}

static int open_pty(const char *link)
{
    int master = posix_openpt(O_RDWR | O_NOCTTY);
    if (master < 0 || grantpt(master) || unlockpt(master)) { perror("pty"); exit(1); }
    int slave = open(ptsname(master), O_RDWR | O_NOCTTY);               /* stays open: no hang-up between two users */
    struct termios t;
    tcgetattr(slave, &t);
    cfmakeraw(&t);
    tcsetattr(slave, TCSANOW, &t);
    unlink(link);
    if (symlink(ptsname(master), link)) { perror(link); exit(1); }
    fcntl(master, F_SETFL, O_NONBLOCK);
    return master;
}

static void send_bytes(int fd, const uint8_t *data, int size)
{
    if (write(fd, data, size) < 0 && errno != EAGAIN) perror("write");
}

/* The VSC. */

static void vsc_send(uint8_t type, const uint8_t *data, int size)
{
    uint8_t frame[64] = {0x10, 0x01, type, size}, a = 0, b = 0;
    memcpy(frame + 4, data, size);
    for (int i = 0; i < size + 4; i++) { a += frame[i]; b += a; }       /* Fletcher */
    frame[size + 4] = a;
    frame[size + 5] = b;
    sent_at = now();                                                    /* before: the reader may be faster than write() */
    send_bytes(vsc, frame, size + 6);
}

static void send_joystick(void)
{
    uint8_t data[14];
    for (int i = 0; i < 6; i++) {
        int value = i == 1 && !estop ? stick : 0, size = abs(value);
        data[2 * i] = (size & 3) << 6 | (value == 0 ? 1 : value < 0 ? 4 : 16);
        data[2 * i + 1] = size >> 2;
    }
    data[12] = deadman && !estop;
    data[13] = 0;
    vsc_send(JOYSTICK, data, sizeof data);
}

static void send_heartbeat(void)
{
    uint8_t data[6] = {0x09, 0, estop};
    vsc_send(HEARTBEAT, data, sizeof data);
}

/* The drive. */

static uint16_t crc(const uint8_t *data, int size)                      /* CRC-16/CCITT-FALSE */
{
    uint16_t sum = 0xFFFF;
    while (size--) {
        sum ^= *data++ << 8;
        for (int i = 0; i < 8; i++) sum = sum & 0x8000 ? sum << 1 ^ 0x1021 : sum << 1;
    }
    return sum;
}

static void send_status(void)
{
    int is_on = enable && now() - asked_at >= enable_ns, value = is_on ? command : 0;
    uint8_t status[STATUS] = {0xF0, 0xF0, is_on, value, value >> 8, 0, is_on};
    uint16_t sum = crc(status + 2, STATUS - 4);
    status[10] = sum;
    status[11] = sum >> 8;
    send_bytes(drive, status, STATUS);
}

static void take_packet(const uint8_t *packet, int64_t at)
{
    int before = command;
    if (packet[2] & 1 && !enable) asked_at = at;
    enable = packet[2] & 1;
    command = (int16_t)(packet[3] | packet[4] << 8);
    if (abs(command - before) > step) step = abs(command - before);
    kept[count % KEPT].at = at;
    kept[count % KEPT].enable = enable;
    kept[count % KEPT].command = command;
    count++;
    if (fired_at && (slows ? abs(command) < abs(before) : !enable)) {
        printf("t %lld\n", (long long)(at - fired_at));
        fired_at = 0;
    }
}

static void read_drive(void)
{
    static uint8_t data[4096];
    static int size;
    int got = read(drive, data + size, sizeof data - size), i = 0;
    int64_t at = now();
    if (got > 0) size += got;
    while (size - i >= PACKET) {
        uint8_t *p = data + i;
        int sound = p[0] == 0xF0 && p[1] == 0xF0 && crc(p + 2, PACKET - 4) == (p[8] | p[9] << 8);
        if (sound) take_packet(p, at); else bad++;
        i += sound ? PACKET : 1;
    }
    memmove(data, data + i, size -= i);
}

/* Commands. */

static void obey(const char *line, int64_t *next_joystick)
{
    char word[32] = "", argument[32] = "";
    sscanf(line, "%31s %31s", word, argument);
    if (!strcmp(word, "stat")) {
        printf("s %d %d %ld %ld %d\n", enable, command, count, bad, step);
        step = 0;
    } else if (!strcmp(word, "packets")) {
        for (long i = count > KEPT ? count - KEPT : 0; i < count; i++)
            if (kept[i % KEPT].at > atoll(argument))
                printf("k %lld %d %d\n", (long long)kept[i % KEPT].at, kept[i % KEPT].enable, kept[i % KEPT].command);
        printf("end\n");
    } else if (!strcmp(word, "fire")) {
        if (!strcmp(argument, "estop")) { estop = 1; send_heartbeat(); *next_joystick = now() + JOYSTICK_NS; }
        else if (!strcmp(argument, "deadman")) { deadman = 0; send_joystick(); }
        else if (!strcmp(argument, "stick")) { stick = 0; send_joystick(); }
        else silent = 1;
        slows = !strcmp(argument, "stick");
        fired_at = sent_at;
    } else {
        fired_at = 0;
        if (!strcmp(word, "stick")) stick = atoi(argument);
        else if (!strcmp(word, "deadman")) deadman = atoi(argument);
        else if (!strcmp(word, "estop")) { estop = atoi(argument); send_heartbeat(); }
        else if (!strcmp(word, "silence")) silent = atoi(argument);
    }
    fflush(stdout);
}

static int read_commands(int64_t *next_joystick)                        /* 0: the input has ended */
{
    static char text[1024];
    static int size;
    int got = read(0, text + size, sizeof text - 1 - size);
    if (got == 0) return 0;
    if (got > 0) size += got;
    text[size] = 0;
    for (char *end; (end = strchr(text, '\n'));) {
        *end = 0;
        obey(text, next_joystick);
        memmove(text, end + 1, (size -= end + 1 - text) + 1);
    }
    return 1;
}

int main(int argc, char **argv)
{
    if (argc != 3) return 2;
    vsc = open_pty(argv[1]);
    drive = open_pty(argv[2]);
    fcntl(0, F_SETFL, O_NONBLOCK);
    int64_t status_ns = setting("STATUS_NS", 10000000);
    enable_ns = setting("ENABLE_NS", 0);
    int64_t next_joystick = now(), next_heartbeat = next_joystick, next_status = next_joystick;
    printf("ready\n");
    fflush(stdout);
    for (;;) {
        int64_t t = now();
        if (t >= next_joystick) { if (!silent) send_joystick(); next_joystick += JOYSTICK_NS; }
        if (t >= next_heartbeat) { if (!silent) send_heartbeat(); next_heartbeat += HEARTBEAT_NS; }
        if (t >= next_status) { send_status(); next_status += status_ns; }
        int64_t due = next_joystick < next_heartbeat ? next_joystick : next_heartbeat;
        if (next_status < due) due = next_status;
        int64_t wait = due - now();
        if (wait < 0) wait = 0;
        struct timespec timeout = {wait / 1000000000, wait % 1000000000};
        struct pollfd ports[3] = {{drive, POLLIN, 0}, {vsc, POLLIN, 0}, {0, POLLIN, 0}};
        ppoll(ports, 3, &timeout, 0);
        uint8_t unread[4096];
        if (ports[1].revents & POLLIN && read(vsc, unread, sizeof unread) < 0) perror("read");
        if (ports[0].revents & POLLIN) read_drive();
        if (ports[2].revents && !read_commands(&next_joystick)) return 0;
        fflush(stdout);
    }
}
