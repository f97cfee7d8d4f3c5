#include "reflexes.h"

#include "numbers.h"

/* Maximum forward speed with a pressed bumper. It is high enough for the wheel control, and
 * harmless when the robot pushes an obstacle. */
#define CREEP_M_S 0.05f
/* Forward travel beyond the floor's edge that latches a stop. The reflex itself stops the robot
 * from 0.2 m/s within 2 to 3 cm. */
#define OVER_M 0.05f
/* Maximum number of control periods with a forward command over a cliff before a stop is latched: 1
 * s. A host reacts to a cliff within 0.07 s. Periods with a reverse command do not count, because
 * the robot needs 1.0 s to return after a speed of 0.28 m/s. */
#define OVER_TICKS 100u
#define SHOWN_TICKS 10u /* one period of the status message */

static void leave(reflexes_t *reflexes)
{
    reflexes->over = false;
    reflexes->ticks = 0;
    reflexes->ahead = 0;
}

static void fade(reflexes_t *reflexes)
{
    if (reflexes->shown != 0) {
        reflexes->shown--;
    }
}

static void follow(reflexes_t *reflexes, const board_encoders_t *counts)
{
    if (reflexes->over) {
        reflexes->ahead += wrapped16((uint16_t)(counts->left - reflexes->counts.left))
            + wrapped16((uint16_t)(counts->right - reflexes->counts.right));
    }
    reflexes->over = true;
    reflexes->counts = *counts;
}

float reflexes_limit(
    reflexes_t *reflexes, float v_m_s, uint8_t contacts, const board_encoders_t *counts)
{
    const bool pressed = contacts & (SP_CONTACT_BUMPER_LEFT | SP_CONTACT_BUMPER_RIGHT);
    float allowed_m_s = v_m_s;
    if (reflexes->at_cliff && (contacts & SP_CONTACT_CLIFF)) {
        if (v_m_s > 0.0f && reflexes->ticks < OVER_TICKS) {
            reflexes->ticks++;
        }
        follow(reflexes, counts);
        allowed_m_s = smaller(v_m_s, 0.0f);
    } else {
        leave(reflexes);
    }
    if (reflexes->at_bumper && pressed) {
        allowed_m_s = smaller(allowed_m_s, CREEP_M_S);
    }
    if (allowed_m_s < v_m_s) {
        reflexes->shown = SHOWN_TICKS;
    } else {
        fade(reflexes);
    }
    return allowed_m_s;
}

void reflexes_rest(reflexes_t *reflexes)
{
    leave(reflexes);
    fade(reflexes);
}

bool reflexes_over(const reflexes_t *reflexes, float metres_per_count)
{
    return reflexes->ticks >= OVER_TICKS
        || 0.5f * (float)reflexes->ahead * metres_per_count >= OVER_M;
}
