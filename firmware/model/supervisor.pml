/* The module's supervisor and brake, the run of a host that commands it, and what can happen in between.
 *
 * One process draws one event after another. Time passes only in ticks, of 300 ms. What was sent may arrive never,
 * once, again, late, and in any order. `python firmware/model/check.py` checks the properties at the end of this
 * file in all states that can be reached; tests/firmware/test_model.py replays random runs on the firmware's core.
 */
#ifndef LINKS
#define LINKS 1   /* with the host's run: its frames may be lost, repeated, late and overtaken */
#endif
#ifndef SERVICE
#define SERVICE 1 /* with faults, settings, SAVE and the brake */
#endif
#ifndef ERROR
#define ERROR NONE /* that is built in, and must be found */
#endif

/* In ticks: the time to live (600 ms), the first stage of TIMEOUT (2 s), the brake's travel, dwell and release. */
#define TTL 2
#define RELAX 7
#define TRAVEL 1
#define DWELL 2
#define RELEASE 1
#define LONG (TTL + RELAX + 1)
/* In half newtons: tension_lower, the highest tension_upper, brake_release_tension. */
#define LOWER 1
#define UPPER 5
#define UNLOADING 4

/* Numbers of set-points have 3 bits for the protocol's 16: one step of the lower 2 is 64 sequence numbers, of the upper
 * one 128 rounds. A set-point that is late by 2 to 4 is so by 128 to 32,768 numbers. Later ones are lost. */
#define NUMBERS 8
#define LATEST 4
#define ahead(number) ((number - last + NUMBERS) % NUMBERS)
#define newer(number) (ERROR == EIGHT_BITS -> ahead(number) % 4 == 1 : ahead(number) > 0 && ahead(number) < 4)

mtype = { idle, armed, running, timed_out, fault, estop };
mtype = { open, closing, closed, releasing, opening };
mtype = { ok, stale, bad_value, bad_state, bad_session, not_calibrated, fault_present, stopped, ignored };
mtype = { away, arming, commanding, stopping, confirmed };
mtype = { ticks, begins, arms, sets, stops, estops, clears, closes, restarts, calibrates, limits_to, saves };
mtype = { NONE, NEVER_EXPIRES, LATE_ONES_RENEW, REPEATED_ARM_RENEWS, BRAKE_STAYS_ON, EIGHT_BITS, ANY_SESSION,
          IGNORES_STOPS, FORGETS_CLOSED_LINKS, CLOSED_LINK_GOES_ON, RESUMES, STOP_LEAVES_ESTOP,
          ARMS_UNCALIBRATED, ARMS_WITH_A_FAULT, NO_CLAMP, SETTINGS_WHILE_PULLING };

/* The module. */
mtype state = idle;
byte age;                 /* ticks since the last set-point or ARM; in TIMEOUT, FAULT and ESTOP, in that state */
byte tension;             /* that the motor is commanded to */
byte wanted;              /* that of the last set-point, */
bool laid;                /* whether that lays the brake on, */
byte last;                /* and its number */
byte session;             /* that armed last: 0 none, 1 the host's, 2 another */
bool current;             /* the host's ARM quotes the count of stops as it is now */
bool bad, latched;        /* a fault is there; one was, and was not cleared */
bool calibrated = !SERVICE;
byte upper = UPPER;
bool saving;
bool saved = !SERVICE;    /* what a start reads: calibrated, */
byte saved_upper = UPPER; /* and tension_upper */
mtype brake = open;
byte brake_age = DWELL;   /* ticks in that state */

/* The host, on one of two links. The module obeys the link in use; on the other it hears STOP and ESTOP. */
mtype host = away;
bool in_use = 1;          /* the host's link is */
byte newest;              /* number of its last set-point or ARM */
byte in_flight;           /* bit n: the set-point n before the newest may still arrive */
byte arm_number, arm_age; /* of the ARM; how many set-points were sent since */
bool arm_sent, stop_sent, arm_acknowledged, stop_acknowledged;

/* For the properties: nothing above depends on it. */
byte silence = LONG;      /* ticks since the last valid ARM or set-point */
byte last_age;            /* how many set-points the host sent since the one that was accepted last */
bool wrong;               /* a set-point was accepted that is late, repeated, or of another session */
bool over = 1;            /* no ARM came since the last STOP, ESTOP, fault or closed link that was sent after it */
bool overtaken;           /* one of these came since the host began, which sent its ARM before */
bool estopped;            /* no CLEAR came since the last ESTOP */

hidden byte number, value, late, lay; /* of the frame that arrives: no part of the state */
hidden mtype code;                    /* of the answer */

#define following (state == armed || state == running)
#define driven (following || state == timed_out)
#define pulling (driven && !(state == timed_out && age >= RELAX))
#define resting (state == idle && tension == 0 && !saving)
#define braking (state == running && laid)

/* An event, as the replay reads it: with what is true of the module afterwards. */
#define SAY(event, a, b, c) printf("EVENT %e %d %d %d %e %e %d %d %e %d %d\n", event, a, b, c, code, state, \
    bad || latched, tension, brake, last, session)
#define NUMBER_AND_VALUE number + 10 * value + 100 * lay

inline enter(next) {
  age = (state == next -> age : 0);
  state = next;
  if
  :: !following -> wanted = 0; laid = 0; last = 0; last_age = 0 /* of no more use */
  :: else
  fi
}

inline move_brake(next) { brake = next; brake_age = 0 }

inline advance_brake() {
  if
  :: brake == open && braking && brake_age >= DWELL -> move_brake(closing)
  :: brake == closing && brake_age >= TRAVEL -> move_brake(closed)
  :: brake == closed && !braking && brake_age >= DWELL && ERROR != BRAKE_STAYS_ON ->
    if
    :: pulling -> move_brake(releasing)
    :: else -> move_brake(opening)
    fi
  :: brake == releasing && (!pulling || brake_age >= RELEASE) -> move_brake(opening)
  :: brake == opening && brake_age >= TRAVEL -> move_brake(open)
  :: else
  fi
}

/* The tension at the end of a tick, which is longer than any ramp. */
inline pull() {
  tension = (state == running -> wanted : LOWER);
  tension = ((brake == releasing || brake == opening) && tension < UNLOADING -> UNLOADING : tension);
  tension = (tension > upper && ERROR != NO_CLAMP -> upper : (tension < LOWER -> LOWER : tension));
  tension = (pulling -> tension : 0)
}

inline tick() {
  if
  :: saving -> saved = calibrated; saved_upper = upper; saving = 0
  :: else
  fi;
  age = ((driven && age < RELAX) || ((state == fault || state == estop) && age < 1) -> age + 1 : age);
  if
  :: following && age > TTL && ERROR != NEVER_EXPIRES -> enter(timed_out); age = 1 /* in the first step of the tick */
  :: else
  fi;
  brake_age = (brake_age < DWELL -> brake_age + 1 : DWELL);
  advance_brake();
  pull();
  silence = (silence < LONG -> silence + 1 : LONG);
  code = ok
}

inline fault_begins() {
  bad = 1;
  if
  :: driven -> latched = 1; enter(fault); tension = 0; advance_brake(); ended()
  :: else
  fi
}

/* An ARM of the host's session, 1, or of another, 2, which is a new one each time. */
inline take_arm(whose) {
  code = (following && session == whose && whose == 1 -> ok :
         (whose == 1 && !current && ERROR != IGNORES_STOPS -> stopped :
         (whose == 1 && session == 1 -> bad_session :
         (state != idle || saving -> bad_state :
         (!calibrated && ERROR != ARMS_UNCALIBRATED -> not_calibrated :
         (bad && ERROR != ARMS_WITH_A_FAULT -> fault_present : ok))))));
  if
  :: code == ok && !following -> enter(armed); session = whose; last = number;
    if
    :: whose == 1 -> last_age = arm_age; over = over && overtaken
    :: else -> over = 0
    fi;
    silence = (over -> silence : 0)
  :: else -> age = (code == ok && ERROR == REPEATED_ARM_RENEWS -> 0 : age)
  fi
}

/* `valid`: it is of the session that armed last, and newer than all that were accepted. */
inline take_set_point(whose, valid) {
  code = (!following && !(state == timed_out && ERROR == RESUMES) -> bad_state :
         (whose != session && ERROR != ANY_SESSION -> bad_session :
         (!newer(number) -> stale :
         (value > upper -> bad_value : ok))));
  if
  :: code == ok -> enter(running); age = 0; wanted = value; laid = lay; last = number;
    if
    :: valid -> silence = 0; last_age = late
    :: else -> wrong = 1
    fi
  :: else -> age = (code == stale && ERROR == LATE_ONES_RENEW -> 0 : age)
  fi
}

inline ended() { over = 1; overtaken = 1 }

inline take_stop() {
  code = (state == fault || (state == estop && ERROR != STOP_LEAVES_ESTOP) -> bad_state : ok);
  current = 0; ended();
  if
  :: code == ok -> enter(idle)
  :: else
  fi
}

inline take_estop() { enter(estop); estopped = 1; current = 0; ended(); code = ok }

inline take_clear() {
  code = (state == fault && bad -> fault_present : ok);
  current = 0;
  if
  :: code == ok -> latched = 0; estopped = 0;
    if
    :: state == fault || state == estop -> enter(idle)
    :: else
    fi
  :: else
  fi
}

inline close_link() {
  if
  :: following && ERROR != CLOSED_LINK_GOES_ON -> enter(timed_out)
  :: else
  fi;
  current = current && ERROR == FORGETS_CLOSED_LINKS;
  ended(); host = (host == stopping -> away : host); stop_acknowledged = 0; code = ok
}

/* What was under way is lost, too: a start takes longer than any frame. */
inline restart() {
  enter(idle); age = 0; tension = 0; session = 0; current = 0; latched = 0; bad = 0; saving = 0;
  calibrated = saved; upper = saved_upper; brake = open; brake_age = DWELL;
  arm_sent = 0; stop_sent = 0; in_flight = 0; arm_acknowledged = 0; stop_acknowledged = 0;
  silence = LONG; estopped = 0; over = 1; overtaken = 0; code = ok
}

/* A run: an answered HELLO, an ARM of a new session, and set-points with numbers that go on from there. */
inline begin() {
  session = (session == 1 -> 2 : session); /* the run before is another's now */
  newest = (newest + 1) % 4; arm_number = newest; arm_age = 0; in_flight = 0; current = 1; overtaken = 0;
  arm_sent = 1; stop_sent = 0; arm_acknowledged = 0; stop_acknowledged = 0; host = arming; code = ok
}

inline send_set_point() {
  newest = (newest + 1) % NUMBERS;
  in_flight = (in_flight << 1 | 1) & ((1 << LATEST) - 1);
  arm_age = (arm_age < LATEST -> arm_age + 1 : LATEST);
  last_age = (following && session == 1 && last_age < LATEST -> last_age + 1 : last_age)
}

inline set(name, from) {
  if
  :: from -> name = value; code = ok
  :: else -> code = bad_state
  fi
}

inline choose_set_point() {
  if
  :: value = 2
  :: SERVICE -> value = 0
  :: SERVICE -> value = UPPER
  :: SERVICE -> value = UPPER + 1
  fi;
  if
  :: lay = 0
  :: SERVICE -> lay = 1
  fi
}

/* A random run draws one of five groups, and seldom faults and what ends everything. */
#ifdef RANDOM
#define SELDOM :: skip :: skip :: skip :: skip :: skip :: skip :: skip :: skip :: skip :: skip
#else
#define SELDOM
#endif

init {
  do
  /* Time passes; a fault begins in the end, or is repaired. */
  :: if
    :: d_step { tick(); SAY(ticks, 0, 0, 0) }
    :: d_step { tick(); SAY(ticks, 0, 0, 0) }
    :: d_step { SERVICE && !bad -> tick(); fault_begins(); SAY(ticks, 1, 0, 0) }
    :: d_step { bad -> tick(); bad = 0; SAY(ticks, 2, 0, 0) }
    SELDOM
    fi

  /* The host goes on. */
  :: if
    :: d_step { LINKS && (host == away || host == confirmed) -> begin(); SAY(begins, 0, 0, 0) }
    :: d_step { host == arming && arm_acknowledged -> host = commanding; arm_acknowledged = 0 }
    :: d_step { host == arming || host == commanding -> send_set_point() }
    :: d_step { host == arming || host == commanding -> host = stopping; stop_sent = 1; arm_acknowledged = 0 }
    :: d_step { host == stopping && stop_acknowledged -> host = confirmed; stop_acknowledged = 0 }
    fi

  /* What it sent arrives. */
  :: if
    :: d_step { arm_sent -> number = arm_number; code = ignored;
        if
        :: in_use -> take_arm(1); arm_acknowledged = host == arming && (arm_acknowledged || code == ok)
        :: else
        fi;
        SAY(arms, 1, in_use, number) }
    :: atomic { in_flight ->
        if
        :: in_flight & 1 -> late = 0
        :: in_flight & 2 -> late = 1
        :: in_flight & 4 -> late = 2
        :: in_flight & 8 -> late = 3
        fi;
        choose_set_point();
        d_step { number = (newest + NUMBERS - late) % NUMBERS; code = ignored;
          if
          :: in_use -> take_set_point(1, session == 1 && late < last_age)
          :: else
          fi;
          SAY(sets, 1, in_use, NUMBER_AND_VALUE) } }
    :: d_step { stop_sent -> take_stop();
        stop_acknowledged = stop_acknowledged || (host == stopping && in_use); /* FAULT and ESTOP count as over */
        SAY(stops, in_use, 0, 0) }
    fi

  /* Others: ARM, set-points of the session 2 and of one that never armed; stops, the link's end, and a restart. */
  :: if
    :: atomic {
        if
        :: number = 0
        :: number = 3
        fi;
        if
        :: d_step { !in_use -> take_arm(2); SAY(arms, 2, 1, number) }
        :: choose_set_point();
          if
          :: d_step { take_set_point(2, session == 2); SAY(sets, 2, 1, NUMBER_AND_VALUE) }
          :: d_step { take_set_point(3, 0); SAY(sets, 3, 1, NUMBER_AND_VALUE) }
          fi
        fi }
    :: d_step { take_stop(); SAY(stops, 0, 0, 0) }
    :: d_step { take_estop(); SAY(estops, 0, 0, 0) }
    :: d_step { close_link(); in_use = 0; SAY(closes, 0, 0, 0) } /* either link is in use then */
    :: d_step { close_link(); in_use = 1; SAY(closes, 1, 0, 0) }
    :: d_step { restart(); SAY(restarts, 0, 0, 0) }
    SELDOM SELDOM
    fi

  /* CLEAR, and settings. */
  :: if
    :: d_step { take_clear(); SAY(clears, 0, 0, 0) }
    :: d_step { SERVICE -> value = 1; set(calibrated, resting); SAY(calibrates, 0, 0, 0) }
    :: d_step { SERVICE -> value = 1; set(saving, resting); SAY(saves, 0, 0, 0) }
    :: atomic { SERVICE ->
        if
        :: value = 3
        :: value = UPPER
        fi;
        d_step { set(upper, resting || (state == idle && !saving && ERROR == SETTINGS_WHILE_PULLING));
          SAY(limits_to, value, 0, 0) } }
    fi
  od
}

/* Never above the limits: below tension_upper, and nothing once FAULT or ESTOP has lasted a tick. */
#define LIMITS (tension <= upper && ((state == fault || state == estop) && age > 0 -> tension == 0))
/* Never armed without calibration, or with a fault. */
#define SOUND (driven -> calibrated && !bad)
/* Released within the time to live of the last valid set-point, whatever is lost; slack, and the brake off, later. */
#define RELEASED (silence > TTL -> !following && tension <= UNLOADING && \
                  (silence >= LONG -> tension == 0 && brake == open))
/* Follows no set-point that is late, repeated, or of another session. */
#define IN_ORDER (!wrong)
/* A stop always wins: no ARM that was sent before it arms after it. */
#define STOP_WINS (over -> !following)
/* An emergency stop lasts until CLEAR. */
#define ESTOP_LASTS (estopped -> state == estop)
/* A host whose stop was confirmed is right to believe it, for good. */
#define CONFIRMATION (host == confirmed -> !(following && session == 1))

ltl limits { [] LIMITS }
ltl sound { [] SOUND }
ltl released { [] RELEASED }
ltl in_order { [] IN_ORDER }
ltl stop_wins { [] STOP_WINS }
ltl estop_lasts { [] ESTOP_LASTS }
ltl confirmation { [] CONFIRMATION }
ltl all { [] (LIMITS && SOUND && RELEASED && IN_ORDER && STOP_WINS && ESTOP_LASTS && CONFIRMATION) }
